"""Blocks meshed anew: lines of a grid in the parameters of a shape, and finer hexahedra."""
