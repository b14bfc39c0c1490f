"""Flight: centroidal control, compensations, paths, observation of a policy, stability margins."""
