"""The tasks: what robots are to do, drawn from what, rewarded for what, and when an episode is over."""
