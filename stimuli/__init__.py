"""From a protocol to a verified folder of clips."""
