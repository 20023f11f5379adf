"""Rigid blocks with friction beside closed forms, printed numbers of others, and compas_cra.

- A block on an incline slides at atan μ; a prism in a groove of angle β tips out when gravity leans
  by β, with friction by β + atan μ; an arch stands without sliding down to t/R = 0.1075.
- Numbers that others printed: `tests.verification.printed_numbers`.
- compas_cra (Kao et al. 2022; ``pip install compas_cra``) has absolute tolerances in its contact
  detection, so it gets metres, and its largest number of neighbours is set to what the assembly
  has, or it would lose contacts. Its RBE lets joints pull at a price.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import time
from functools import partial
from typing import Any

import numpy as np
import pytest

from geometry import CircularArch, PolyhedralAssembly, RunningBondWall
from geometry.files.hexahedral_solids import flat_side
from mbd import contact_jacobian
from mbd.contacts.friction import frictional_contacts
from mbd.equilibrium import frictional_equilibrium
from mbd.mechanism import classify
from tests.support.dome import hemisphere
from tests.support.limit_programs import lune, stands
from tests.verification import printed_numbers as others
from tests.verification.closed_forms import (
    ARCH_LIMIT,
    arch_limit,
    body_force,
    groove,
    incline,
    tilt_limit,
)

#: A pull above this part of the largest force says that the assembly does not stand.
TENSION = 1e-4


def closed_forms():
    """Every limit beside its closed form, in degrees or t/R."""
    found: dict[str, tuple[float, float]] = {}
    for mu in (0.3, 0.7):
        name = f"incline, μ = {mu} [°]"
        found[name] = np.degrees((tilt_limit(incline(), mu), np.arctan(mu)))
    for degrees in (30.0, 60.0):
        for mu in (0.0, 0.2):
            exact = np.radians(degrees) + np.arctan(mu)
            name = f"prism in a {degrees:g}° groove, μ = {mu} [°]"
            found[name] = np.degrees((tilt_limit(groove(np.radians(degrees)), mu), exact))
    for n in (20, 40, 80):
        found[f"arch of {n} voussoirs, t/R"] = arch_limit(n), ARCH_LIMIT
    for name, (ours, exact) in found.items():
        yield {"problem": name, "found": ours, "closed form": exact, "difference": ours - exact}


def printed():
    """Every number that others printed beside ours."""
    for name, (associated, sliding) in others.PRINTED.items():
        found = others.wall_factors(name)
        yield {"problem": f"{name}, with dilation", "ours": found.associated, "printed": associated}
        proof = f"{found.certified}, all laws to {found.check.largest:.0e}" if found.check else ""
        yield {
            "problem": f"{name}, without",
            "ours": found.factor,
            "printed": sliding,
            "certified": proof,
        }
    arch = others.straight_arch_limit()
    yield {"problem": "arch of 27 voussoirs, h/R", "ours": arch, "printed": others.ARCH_OF_27}
    for friction, verdict in ((0.50, "stays"), (0.49, "slides")):
        # At the limit itself the answer is the edge of two: compare to the solver's accuracy.
        stays = others.incline_slope(friction) >= 0.5 - 1e-7
        name = f"incline of 26.565°, μ = {friction:.2f}"
        yield {"problem": name, "ours": "stays" if stays else "slides", "printed": verdict}


# ---------------------------------------------------------------------------------------------
# compas_cra

#: Walls that grow, and arches on both sides of the limit t/R = 0.1075: the assembly, friction, and
#: whether it stands by theory.
PROBLEMS = {
    f"wall {n} × {n}": (RunningBondWall((240.0, 115.0, 71.0), n, n).build, 0.6, True)
    for n in (3, 5, 8, 12, 16)
} | {
    f"arch t/R = {ratio}": (
        partial(CircularArch(1000.0, 1000.0 * ratio, 300.0, 20).build, pieces=1),
        1.0,
        theory,
    )
    for ratio, theory in ((0.12, True), (0.10, False))
}
# By faces alone: corners where four voussoirs meet would tie the rings.
PROBLEMS |= {
    f"dome t/R = {ratio}": (partial(hemisphere, ratio, 8, 6), 0.5, stands(lune(ratio, 8, 6), 0.5))
    for ratio in (0.05, 0.03)
}
QUICK = ("wall 3 × 3", "arch t/R = 0.12", "arch t/R = 0.1", "dome t/R = 0.05", "dome t/R = 0.03")


def ours(name: str) -> tuple[bool | None, dict[str, Any]]:
    """Verdict with friction and its row: certified, with the frictionless mechanism class."""
    build, friction, theory = PROBLEMS[name]
    start = time.process_time()
    assembly = build().bearing()
    contacts = contact_jacobian(assembly)
    detected = time.process_time()
    load = body_force(assembly, np.array([0.0, 0.0, -1.0]))
    found = frictional_equilibrium(frictional_contacts(assembly, contacts, friction), load)
    solved = time.process_time()
    mechanism = classify(contacts.jacobian, load).mechanism
    stands = found.holds if found.holds or found.mechanism is not None else None
    proof = f"residual {found.residual:.0e}" if found.holds else "mechanism certified"
    return stands, {
        "problem": name,
        "theory": theory,
        "program": "tubelock",
        "blocks": len(assembly.free_blocks),
        "contacts": len(contacts.areas),
        "stands": stands,
        "detect [s]": detected - start,
        "solve [s]": solved - detected,
        "note": f"{proof}; frictionless: {mechanism}",
    }


def compas_answer(name: str, solver: str) -> tuple[bool, dict[str, Any]]:
    """Rigid-block equilibrium (rbe) or coupled rigid-block analysis (cra) of compas_cra."""
    from compas_assembly.datastructures import Block
    from compas_cra import equilibrium
    from compas_cra.algorithms import assembly_interfaces_numpy
    from compas_cra.datastructures import CRA_Assembly

    build, friction, theory = PROBLEMS[name]
    assembly = build()
    peer = CRA_Assembly()
    for block in range(assembly.n_blocks):
        vertices, faces = _faces(assembly, block)
        peer.add_block(Block.from_vertices_and_faces(vertices.tolist(), faces), node=block)
    peer.set_boundary_conditions(np.flatnonzero(assembly.fixed).tolist())
    start = time.process_time()
    with contextlib.redirect_stdout(io.StringIO()):
        assembly_interfaces_numpy(peer, nmax=assembly.n_blocks, tmax=1e-6, amin=1e-6)
    detected = time.process_time()
    stands, note = _solve(getattr(equilibrium, f"{solver}_solve"), peer, friction)
    return stands, {
        "problem": name,
        "theory": theory,
        "program": f"compas_cra, {solver}",
        "blocks": len(assembly.free_blocks),
        "contacts": sum(len(interface.points) for interface in _interfaces(peer)),
        "stands": stands,
        "detect [s]": detected - start,
        "solve [s]": time.process_time() - detected,
        "note": note,
    }


def _faces(assembly: PolyhedralAssembly, block: int) -> tuple[np.ndarray, list[list[int]]]:
    """Vertices [m] and planar polygons of a convex block."""
    shape = assembly.shape(block)
    faces = [flat_side(shape, plane) for plane in np.unique(shape.plane_of).tolist()]
    return assembly.points(block) / 1000.0, faces


def _interfaces(peer: Any) -> list[Any]:
    edges = peer.graph.edges()
    return [i for edge in edges for i in peer.graph.edge_attribute(edge, "interfaces")]


def _solve(solve: Any, peer: Any, friction: float) -> tuple[bool, str]:
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            solve(peer, mu=friction, density=1.0)
    except ValueError as error:
        return False, str(error)
    forces = [force for interface in _interfaces(peer) for force in interface.forces]
    push = max(abs(force["c_np"]) for force in forces)
    pull = max(abs(force["c_nn"]) for force in forces)
    return pull <= TENSION * push, f"solved, largest pull {pull / push:.0e} of the largest push"


def peers():
    """Every problem through every program that is installed."""
    ours(QUICK[0])  # compiled loops are loaded before anything is timed
    for name in PROBLEMS:
        yield ours(name)[1]
        if importlib.util.find_spec("compas_cra") is not None:
            yield from (compas_answer(name, solver)[1] for solver in ("rbe", "cra"))


@pytest.mark.parametrize("name", QUICK)
def test_our_side_of_the_peer_comparison_agrees_with_theory(name):
    assert ours(name)[0] is PROBLEMS[name][2]


@pytest.mark.parametrize("name", QUICK)
def test_compas_cra_agrees_where_it_is_installed(name):
    pytest.importorskip("compas_cra")
    assert compas_answer(name, "rbe")[0] is PROBLEMS[name][2]
