"""Code shared by the recipes: environments, rewards, the learner, paired evaluation, run folders and reports."""
