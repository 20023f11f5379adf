"""Hexahedra: stiffness, mass, stress, stable time step of one element."""
