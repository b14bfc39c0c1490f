"""The controller that flies in the simulator and on the robot: it knows no simulator, no gymnasium, no torch."""
