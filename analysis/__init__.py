"""Statistics, plots and a report from session journals."""

SEED = 20_240_229
"""Every random draw of an analysis starts here: same journals, same numbers."""
