"""The search for the presets `tuned` and `robust_overlapped`: CMA-ES on tracks, with scenarios of its own."""
