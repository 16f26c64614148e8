"""`metamerlab demo`: the whole chain, from photographs and scenes to a report, on one page."""
