"""The paper's experiments, and studies of their controllers."""
