"""Allocation: the QP of the paper, its blocks, modes, solvers and fallbacks."""
