"""Deformable blocks: finite elements, explicit dynamics and statics."""
