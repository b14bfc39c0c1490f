"""The native library: C sources shared with the robot, their Python bindings, code generators."""
