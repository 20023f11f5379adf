"""Deformable answers as text and files."""
