"""OpenGL plumbing: context, shaders, textures, timers."""
