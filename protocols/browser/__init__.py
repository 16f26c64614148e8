"""Studies in a browser: the design as a browser plans it, the export, lines that come home."""
