"""Pull-push with squared weights, as a rendering programmer's note of 2009 describes it."""
