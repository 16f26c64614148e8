"""The formats for people and editors: published schemas, and pages made from them."""
