"""Sources of frames: one module per built-in scene, or importer of meshes, photographs, OpenEXR."""
