"""Linear solvers: which there are, and what each does with a scheme's matrix."""
