"""The report: one self-contained HTML file, a JSON of every number, tables and figures."""
