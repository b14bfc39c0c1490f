"""What goes to the robot: export of core and policy, golden recordings, the runner and its build."""
