"""Studies in a browser: the folder that a page runs, and the lines that come home from it.

``src/kernel`` is plan, session and trial in TypeScript, of which Python is the definition.
"""
