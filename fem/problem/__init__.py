"""The statement of a problem for the solvers of deformable blocks."""
