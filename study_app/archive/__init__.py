"""A study in one file: written whole, proven whole, encrypted if wanted, and restored."""
