"""Seed of chance: a module of its own, so that `--help` need not load the statistics."""

SEED = 20_240_229
"""Every random draw of an analysis starts here: same journals, same numbers."""
