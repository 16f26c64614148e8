"""Commands of `metamerlab session`."""
