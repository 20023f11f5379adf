"""Blocks and meshes from files, and to files."""
