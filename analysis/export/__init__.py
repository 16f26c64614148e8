"""Exports of recorded studies in the forms that archives and other programs read."""
