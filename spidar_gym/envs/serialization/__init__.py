"""Environments and their robots as bytes: copies, pickles, saved states, and what these are held to."""
