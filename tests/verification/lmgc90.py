"""A barrel vault beside a stored run of LMGC90: ``python -m tests.verification --lmgc90 FILE``.

The file is ``DEM_results.json`` of the barrel vault among the analyses that compas_dem publishes:
blocks, and the contact forces that LMGC90 found by dynamics with friction 0.5, 2000 kg/m³. Rigid
blocks have many states in equilibrium. Thrust is the horizontal force of one abutment; the least
and the largest follow from cone programs over all admissible states.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from geometry import Answer
from mbd import contact_jacobian
from mbd.contact_jacobian import Contacts
from mbd.force_range import DETERMINED
from mbd.friction import FrictionalContacts, frictional_contacts, least_forces
from mbd.programs import Work
from validation import load_case, solve

#: Of the stored run; density in t/mm³.
FRICTION, DENSITY = 0.5, 2e-9


def stored(path: Path) -> dict[tuple[int, int], tuple[np.ndarray, float]]:
    """Force on the first block of each joint (3,) and its normal part, by numbers of nodes [N]."""
    data = json.loads(path.read_text("utf-8"))["data"]["model"]["data"]["graph"]
    graph = data.get("data", data)
    return {
        (int(a), int(b)): (np.array(joint["force"]), float(sum(joint["force_normal"])))
        for a, others in graph["edge"].items()
        for b, joint in others.items()
    }


def analysed(path: Path) -> Answer:
    """Our answer to the same blocks, with the range of each joint's force."""
    with TemporaryDirectory() as folder:
        scene = Path(folder, "vault.toml")
        scene.write_text(
            f'[block]\ntype = "mesh"\nunits = "m"\n[[parts]]\nfile = "{path.resolve()}"\n'
            "[material]\nyoung_modulus = 20000.0\npoisson_ratio = 0.2\n"
            f"density = {DENSITY}\n[effects]\ngravity = [0.0, 0.0, -9810.0]\n"
            f"[effects.friction]\ncoefficient = {FRICTION}\n[rigid]\nranges = true\n",
            "utf-8",
        )
        run = solve(load_case(str(scene), method="rigid"))
    assert isinstance(run, Answer)
    return run


def extreme_thrust(
    contacts: Contacts, frictional: FrictionalContacts, load: np.ndarray, along: np.ndarray
) -> float:
    """Least along · λ over all admissible forces, (3 n_contacts,); -inf where there is none [N]."""
    size = float(np.linalg.norm(load))
    result = least_forces(frictional, load / size, cost=along, work=Work())
    return size * float(along @ np.asarray(result.x)) if "Solved" in str(result.status) else -np.inf


def _abutment(run: Answer) -> np.ndarray:
    """Contacts of free blocks on the fixed blocks at small x, (n_contacts,)."""
    assembly, found = run.details.blocks, run.details.blocks.interfaces
    middle = assembly.centroids[:, 0].mean()
    held = assembly.fixed & (assembly.centroids[:, 0] < middle)
    return (held[found.block_m] != held[found.block_s])[run.details.contact_index]


def _thrusts(run: Answer) -> dict[str, float]:
    """Thrust of the least-norm answer, the least and the largest one [N]."""
    assembly, load = run.details.blocks.bearing(), run.details.load
    contacts = contact_jacobian(assembly, load.fixed, load.held)
    frictional = frictional_contacts(assembly, contacts, FRICTION)
    force = contacts.rows(load.wrenches)
    counted = slice(None) if run.details.counted is None else run.details.counted
    here, forces = _abutment(run)[counted], run.details.forces[counted]
    held = assembly.fixed[contacts.block_s[here]]
    normals = assembly.interfaces.normals[contacts.index]
    axes = np.concatenate([normals[:, None], frictional.tangents], axis=1)[:, :, 0]
    along = np.zeros_like(axes)
    along[here] = np.where(held, -1.0, 1.0)[:, None] * axes[here]
    shown = forces[here] * np.where(held, -1.0, 1.0)[:, None]
    flat = along.ravel()
    return {
        "least-norm": float(shown[:, 0].sum()),
        "least": extreme_thrust(contacts, frictional, force.ravel(), flat),
        "largest": -extreme_thrust(contacts, frictional, force.ravel(), -flat),
    }


def rows(path: Path) -> Iterator[dict[str, Any]]:
    """Weight, thrust and joint forces of both programs."""
    theirs, run = stored(path), analysed(path)
    assembly, further = run.assembly, run.further
    assert further is not None
    assert further.ranges is not None
    fixed, left = assembly.fixed, assembly.centroids[:, 0] < assembly.centroids[:, 0].mean()
    thrust = weight = 0.0
    for (a, b), (force, _) in theirs.items():
        weight += force[2] * (int(fixed[b]) - int(fixed[a]))
        thrust += force[0] * (int(fixed[b] & left[b]) - int(fixed[a] & left[a]))
    reaction = run.report["reaction"][2]
    yield {"quantity": "weight carried [N]", "LMGC90": abs(weight), "tubelock": reaction}
    ours = _thrusts(run)
    yield {
        "quantity": "thrust of one abutment [N]",
        "LMGC90": abs(thrust),
        "tubelock": ours["least-norm"],
        "least": ours["least"],
        "largest": ours["largest"],
    }
    ranges = further.ranges
    inside = 0
    for k, (m, s) in enumerate(zip(ranges.block_m, ranges.block_s, strict=True)):
        force = theirs.get((int(m), int(s))) or theirs[int(s), int(m)]
        slack = DETERMINED * ranges.load
        inside += ranges.least[k] - slack <= force[1] <= ranges.largest[k] + slack
    yield {
        "quantity": "joints whose normal force lies between our least and largest",
        "LMGC90": f"{inside} of {len(ranges.least)}",
        "tubelock": f"{ranges.unbounded.sum()} without largest force",
    }
