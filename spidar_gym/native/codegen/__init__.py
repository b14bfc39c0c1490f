"""Generators of C: headers, and solvers of the programs."""
