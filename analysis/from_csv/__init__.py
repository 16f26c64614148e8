"""One table, one question, one answer: analyses of a CSV file without a study around it."""
