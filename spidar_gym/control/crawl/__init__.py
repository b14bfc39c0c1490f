"""Crawling: gait, footsteps, legs, the controller on the ground, what a policy sees."""
