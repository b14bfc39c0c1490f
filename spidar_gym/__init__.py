"""SPIDAR in simulation: Gymnasium environments whose zero action is the paper's controller."""

__version__ = "0.1.0"
