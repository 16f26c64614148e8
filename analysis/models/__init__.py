"""Models and tests: they take arrays or tables, and know no words."""
