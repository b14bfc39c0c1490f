"""The search for the presets `tuned` and `robust_overlapped`: by CMA-ES or by pattern, on scenarios of its own."""
