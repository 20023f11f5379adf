"""Static equilibrium of blocks in contact."""
