"""The path: the hover, moved along a way through the air."""
