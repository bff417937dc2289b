"""A phone that streams, and a page that shows where it is."""
