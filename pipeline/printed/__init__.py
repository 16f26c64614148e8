"""Metameric inpainting as its paper prints it, without what was found since."""
