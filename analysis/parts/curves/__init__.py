"""Parts of a report about psychometric functions."""
