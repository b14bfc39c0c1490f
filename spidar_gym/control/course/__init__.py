"""Courses: gates that span the field, their map, and the rule that chooses gait and form from it."""
