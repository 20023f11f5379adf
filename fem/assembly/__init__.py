"""Assemblies as deformable blocks: symmetry, supports, state of contact."""
