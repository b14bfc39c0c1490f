"""Identification of a robot's parameters from the logs of its tests."""
