"""Searches for the presets, on separate scenarios, and the margins of flight controllers."""
