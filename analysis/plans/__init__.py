"""Plans of analyses: settings from a protocol, or from the options of a table. Parts read these."""
