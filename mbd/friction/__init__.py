"""Equilibrium with Coulomb friction, and whether the load itself brings it about."""
