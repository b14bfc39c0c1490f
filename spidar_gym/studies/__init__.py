"""Studies beyond the paper, each with a table of results: `python -m spidar_gym.studies NAME`."""
