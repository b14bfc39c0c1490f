"""Learning on top of the allocator: training scripts, their presets, and what they share."""
