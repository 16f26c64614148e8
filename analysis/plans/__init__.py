"""What analyses are told: by a protocol, or by the options of a table. Parts read these."""
