"""Code for the real robot: export of core and policy, golden recordings, the runner and its build."""
