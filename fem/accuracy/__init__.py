"""Answers of a stated accuracy: meshes from coarse to fine, and error bars from their changes."""
