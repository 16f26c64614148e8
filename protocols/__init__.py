"""Every format that two packages share. Imports none of our other packages."""
