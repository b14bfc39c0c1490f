"""The simulated robot behind the real robot's interface: the runner drives it in place of SPIDAR."""
