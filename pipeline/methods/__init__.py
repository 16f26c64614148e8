"""Every way to fill holes, selectable by name under one signature.

`registry.create_method` makes one by name; `method.Method` is the signature.
"""
