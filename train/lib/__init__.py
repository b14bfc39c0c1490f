"""What the recipes share: environments and rewards, the learner, paired evaluation, runs and what they report."""
