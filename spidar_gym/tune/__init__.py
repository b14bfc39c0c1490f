"""The search for the presets `tuned` and `robust_overlapped`, by CMA-ES or pattern search on separate scenarios."""
