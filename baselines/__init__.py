"""Baselines of the leaderboard, a file each; learned ones are artifacts in `artifacts/`."""
