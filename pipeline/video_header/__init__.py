"""Statements of a video file on its pictures: read from its header, judged by one table."""
