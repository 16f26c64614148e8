"""Files and folders on disk: read and written whole, locked, hashed, removed only if ours.

`result_folder` is what commands fill.
"""
