"""Rigid placements as Abaqus spells them: a translation, then a rotation about an axis.

Numbers in a deck are decimal; a rotation matrix read back from them differs in its last bits.
`canonical_axis_angle` returns an axis and an angle that survive writing and reading, so that a
deck made from a deck is the same text.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from fem.decks.keywords import real
from geometry.assembly import Assembly
from geometry.mesh import FloatArray, cross_matrix

#: Largest difference of two rotation matrices that count as the same.
_SAME = 1e-15

#: Digits written: two fewer than a float has, so that rounding undoes the errors of reading.
_DIGITS = 14

AxisAngle = tuple[FloatArray, float]


def rotation_matrix(axis: FloatArray, degrees: float) -> FloatArray:
    """Rotation by an angle [degrees] about a direction, (3, 3) (Rodrigues)."""
    n = axis / np.linalg.norm(axis)
    cosine, sine = _cosine_sine(degrees)
    return cosine * np.eye(3) + sine * cross_matrix(n) + (1.0 - cosine) * np.outer(n, n)


def _cosine_sine(degrees: float) -> tuple[float, float]:
    """Cosine and sine, exact at multiples of a right angle."""
    quarter, rest = divmod(degrees, 90.0)
    c, s = math.cos(math.radians(rest)), math.sin(math.radians(rest))
    for _ in range(int(quarter) % 4):
        c, s = -s, c
    return c, s


def canonical_axis_angle(rotation: FloatArray) -> AxisAngle:
    """Direction and angle [degrees] with the shortest decimals, fixed under writing and reading.

    Parameters
    ----------
    rotation
        (3, 3); the matrix of the result differs from it by less than 1e-13.
    """
    result = _shortest(rotation)
    for _ in range(20):
        again = _shortest(rotation_matrix(*result))
        if (again[0] == result[0]).all() and again[1] == result[1]:
            break
        result = again
    return result


def _shortest(rotation: FloatArray) -> AxisAngle:
    """Axis and angle with the fewest digits that give the same matrix."""
    vector = Rotation.from_matrix(rotation).as_rotvec()
    angle = float(np.linalg.norm(vector))
    if angle == 0.0 or np.abs(rotation - np.eye(3)).max() <= _SAME:
        return np.array([0.0, 0.0, 1.0]), 0.0
    axis = vector / angle
    if axis[np.argmax(np.abs(axis))] < 0.0:
        axis, angle = -axis, -angle
    axis = axis / np.abs(axis).max()
    degrees = math.degrees(angle)
    candidate = axis, degrees
    for digits in range(3, _DIGITS + 1):
        candidate = _rounded(axis, degrees, digits)
        if np.abs(rotation_matrix(*candidate) - rotation).max() <= _SAME:
            break
    return candidate


def _rounded(axis: FloatArray, degrees: float, digits: int) -> AxisAngle:
    return rounded(axis, digits), float(rounded(np.array([degrees]), digits)[0])


def rounded(vector: FloatArray, digits: int = _DIGITS) -> FloatArray:
    """Round each component to a number of significant digits."""
    return np.array([float(real(float(f"{x:.{digits}g}"))) for x in vector.tolist()])


def canonical(assembly: Assembly) -> Assembly:
    """Return the same assembly with rotations that survive writing and reading."""
    angles = [canonical_axis_angle(rotation) for rotation in assembly.rotations]
    return replace(assembly, rotations=np.array([rotation_matrix(*a) for a in angles]))


def placement_rows(rotation: FloatArray, translation: FloatArray) -> list[list[float]]:
    """Data lines of ``*Instance``: translation; axis point, second axis point and angle.

    Abaqus translates first, then turns about the axis: x = R (X + T - a) + a. With a = T the
    translation is that of x = R X + T.
    """
    axis, degrees = canonical_axis_angle(rotation)
    if degrees == 0.0:
        return [translation.tolist()] if translation.any() else []
    # Far away along the axis where it is oblique, so that the difference keeps its digits.
    reach = 1.0 if np.count_nonzero(axis) == 1 else 1000.0
    return [
        translation.tolist(),
        [*translation.tolist(), *(translation + reach * axis).tolist(), degrees],
    ]
