"""Statements that files make about themselves: one table of what is honoured, refused or noted."""
