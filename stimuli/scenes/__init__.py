"""Where frames come from: one module per built-in scene or importer."""
