"""Statistics, plots and a report from session journals."""
