"""Explicit dynamics: the step, and the run around it."""
