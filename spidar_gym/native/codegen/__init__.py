"""What is generated into C: headers, and solvers of the programs."""
