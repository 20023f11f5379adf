"""What loads blocks, and the load cases that have names."""
