"""The simulated robot: MuJoCo and everything that imitates hardware. It knows no controller."""
