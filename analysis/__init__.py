"""From session journals to statistics, plots and a report."""
