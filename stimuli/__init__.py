"""Build of a verified folder of clips from a protocol."""
