"""Serialisation of environments and their robots: copies, pickles, saved states, and their validation."""
