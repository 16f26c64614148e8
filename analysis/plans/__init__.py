"""Plans of analyses: the section of a study or of a table, and what it is about. Parts read these."""
