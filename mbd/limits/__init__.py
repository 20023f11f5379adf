"""Limits of rigid blocks: pushes, load factors at collapse, ranges of contact forces."""
