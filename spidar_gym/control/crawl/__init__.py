"""Crawling: gait, footsteps, leg kinematics, controller, observation of a policy."""
