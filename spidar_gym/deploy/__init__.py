"""From the simulator to the robot: export of the onboard core, its runner, software in the loop."""
