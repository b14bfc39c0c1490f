"""Hover-v0: hold the CoG while the joints go through a sequence of forms."""
