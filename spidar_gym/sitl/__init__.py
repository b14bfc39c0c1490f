"""The simulated robot behind the real robot's interface: what the runner that drives SPIDAR drives instead."""
