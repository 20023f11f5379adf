"""What joints transmit, as plain data: the same keys for rigid and for deformable blocks."""

from __future__ import annotations

from typing import Any

from geometry.measures import JointResultants


def joints_json(joints: JointResultants) -> list[dict[str, Any]]:
    """Resultants of each joint as plain data.

    ``force`` and ``moment`` act on the second of ``blocks``, the moment about ``centroid``, that
    of the contact area; ``normal`` points from the first to the second. ``normal_force`` is
    positive where blocks press and acts at ``point``, ``eccentricity`` from the centroid. Lengths
    in mm, forces in N, moments in N mm, world axes.
    """
    columns = {
        "force": joints.forces,
        "moment": joints.moments,
        "normal_force": joints.normal_force,
        "shear_force": joints.shear_force,
        "bending_moment": joints.bending_moment,
        "twisting_moment": joints.twisting_moment,
        "eccentricity": joints.eccentricity,
        "point": joints.points,
        "centroid": joints.centroids,
        "normal": joints.normals,
        "area": joints.areas,
    }
    return [
        {
            "blocks": [int(joints.block_m[k]), int(joints.block_s[k])],
            **{name: values[k].tolist() for name, values in columns.items()},
        }
        for k in range(len(joints.block_m))
    ]
