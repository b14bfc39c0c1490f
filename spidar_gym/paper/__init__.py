"""The paper's experiments, studies around them, and the search for `tuned`."""
