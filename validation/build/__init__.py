"""From scenes to what the solvers take."""
