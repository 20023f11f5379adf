"""Equilibrium of rigid blocks without friction, and the class of their mechanism."""
