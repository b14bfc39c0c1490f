"""The paper's experiments, and studies around them."""
