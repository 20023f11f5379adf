"""Runs of rigid blocks, what is asked of them beside equilibrium, and runs that share blocks."""
