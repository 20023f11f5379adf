"""Pixels of a picture."""

from __future__ import annotations

import io

import numpy as np


def open_pixels(png: bytes) -> np.ndarray:
    """(height, width, 3), 0 … 1."""
    import matplotlib.image

    return matplotlib.image.imread(io.BytesIO(png))[..., :3]
