"""Stimuli from scenes and pictures to clips on disk, each application in a folder.

`worker` holds what builders of plug-ins import: the renderer, and its thread.
"""
