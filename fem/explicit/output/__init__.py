"""What an explicit run keeps: energies, history, checkpoints."""
