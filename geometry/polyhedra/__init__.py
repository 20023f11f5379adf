"""Blocks as closed triangulated surfaces, and how they meet."""
