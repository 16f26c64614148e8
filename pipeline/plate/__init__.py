"""Fills that stay from view to view: a plate in the source frame."""
