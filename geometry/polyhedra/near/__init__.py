"""Triangles that are near each other: trees of boxes, and distances of triangles."""
