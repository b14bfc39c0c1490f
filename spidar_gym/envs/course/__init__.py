"""The course: one robot takes off, flies, changes its form, lands and crawls."""
