"""Courses: gates that span the field, what a map tells of them, and the rule that chooses gait and form by them."""
