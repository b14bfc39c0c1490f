"""The onboard core behind Python: sources shared with the robot, bindings, generators."""
