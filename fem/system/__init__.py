"""Deformable blocks as arrays: elements, loads, supports, symmetry, state of contact."""
