"""Studies beyond the paper, each with its table: `python -m spidar_gym.studies NAME`."""
