"""A study in one file: written whole, and proven whole."""
