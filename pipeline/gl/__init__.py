"""OpenGL plumbing: context, shaders, textures, timers.

`compute` binds by name, `passes` is common to all passes, `fragment` makes WebGL2's shaders
of ours.
"""
