"""Tables of any program: files, words, units and rows, read in one way by every command."""
