"""Policies: protocol, presets, learned artifacts, and loading by name."""
