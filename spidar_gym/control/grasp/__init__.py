"""Whole-body grasping: the legs' form around an object, the forces of the feet on it, and the phases of a mission."""
