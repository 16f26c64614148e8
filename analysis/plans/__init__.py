"""Plans of analyses: the section of a study or of a table, and its facts. Parts read these."""
