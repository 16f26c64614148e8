"""Tables of any program: files, words, units and rows, read in one way by every command.

`table_files` reads rows of text; `words`, `column_units` and `unwanted_rows` say what they mean;
`table` holds them. Then come trials, preferences and ratings.
"""
