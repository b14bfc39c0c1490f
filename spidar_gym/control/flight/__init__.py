"""Flight: centroidal control, compensations, what a policy sees, margins."""
