"""Stresses from displacements: at nodes and integration points, their peaks, averages, sections."""
