"""Tasks: options, sampled conditions, rewards, failures and success of an episode."""
