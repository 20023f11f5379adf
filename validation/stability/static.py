"""Robustness cases of statics: contrasts, loads and mechanisms between deformable blocks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fem.accuracy.one_mesh import static_state
from fem.contact.law import ExponentialLaw
from fem.element.hexahedron import ElementType
from fem.element.material import Material
from fem.problem import Problem, ProblemError
from fem.static.result import StaticError
from fem.static.solve import StaticMethod, StaticOptions, solve_static
from geometry.assembly import moved
from geometry.families.hexagon_block import HexagonBlock, HexagonBlockDivisions
from geometry.families.sine_block import SineBlockDivisions
from geometry.families.tube import HexagonTube
from geometry.loads import named_load
from validation.stability.case import Cases, Check, Finding, refusal
from validation.stability.contact_law import COLUMN_LAW, TOLERANCE, pressed_column, solved_column
from validation.stability.problems import (
    BRICK,
    COLUMN,
    CONCRETE,
    deformable,
    pressed,
    relative,
    stack,
    tube,
)

CASES = Cases("static")


@CASES.add("stiffness-contrast-1000", "A block 1 000 times stiffer than its neighbour: closed form")
def _contrast() -> Finding:
    pressure, law = 0.01, ExponentialLaw()
    assembly = stack(1)
    stiff = replace(COLUMN, young_modulus=1000.0 * COLUMN.young_modulus)
    stated = deformable(assembly, pressed(assembly, pressure), material=(COLUMN, COLUMN, stiff))
    result = solve_static(stated, StaticOptions(tolerance=TOLERANCE, symmetry=1))
    share = pressure * BRICK[2]
    sunk = share / COLUMN.young_modulus + share / stiff.young_modulus
    sunk += 2 * float(law.overclosure(pressure))
    top = -float(result.displacements[1][0, :, 2].min())
    return Finding(
        Check("residual", result.evidence.residual, TOLERANCE),
        Check("joint pressures", relative(result.pressures, np.array(pressure)), 1e-6),
        Check("top against the closed form", relative(top, sunk), 1e-6),
    )


CASES.case("load-1e-12-static", f"Load of 1e-12 MPa: {COLUMN_LAW}", pressed_column, 1e-12)
CASES.case(
    "load-1e4-static", f"Load of 1e4 MPa on linear blocks: {COLUMN_LAW}", pressed_column, 1e4
)


@CASES.add("load-1e9-static", "Load of 1e9 MPa, a strain of 33 000: rejected where it is stated")
def _huge() -> Finding:
    return refusal(lambda: solved_column(1e9), ProblemError, "pressure: got", "expected less")


@CASES.add(
    "strain-1e4-static", "Blocks so soft that their strain is 11 000: rejected, the motion named"
)
def _soft() -> Finding:
    assembly = stack(1)
    soft = replace(COLUMN, young_modulus=3e-5 * COLUMN.young_modulus)
    stated = deformable(assembly, pressed(assembly, 1e4))
    bodies = tuple(replace(body, material=soft) for body in stated.bodies)
    return refusal(
        lambda: solve_static(replace(stated, bodies=bodies), StaticOptions(symmetry=1)),
        StaticError,
        "block lengths",
        "expected",
    )


@CASES.add("zero-load-static", "No load between fixed rows: equilibrium of touching surfaces")
def _no_load() -> Finding:
    assembly = stack(2, top_fixed=True)
    empty = replace(pressed(assembly, 0.0), faces=())
    result = solve_static(deformable(assembly, empty), StaticOptions(symmetry=1))
    # Surfaces press a little where they just touch; nothing can press more than that.
    touching = float(ExponentialLaw().pressure(0.0))
    return Finding(
        Check("residual", result.evidence.residual, 1e-8),
        Check("largest pressure [MPa]", float(result.pressures.max()), touching * 1.000001),
    )


@CASES.add(
    "mechanism-driven-static",
    "A column pushed sideways, nothing resists: rejected, or its blocks are named as loose",
)
def _driven() -> Finding:
    assembly = stack(2)
    stated = deformable(assembly, pressed(assembly, 0.01, face="inner"))
    try:
        result = solve_static(stated, StaticOptions(symmetry=1))
    except StaticError as error:
        said = "expected" in str(error)
        return Finding(Check("says what is expected", said, 1, 1), refusal=str(error))
    return Finding(Check("called converged", result.converged, 0), refusal=result.evidence.status)


@CASES.add("offset-1e6-mm-static", "The tube 1e6 mm from the origin: same pressures")
def _offset() -> Finding:
    assembly = tube(1)
    away = moved(assembly, np.eye(3), np.array([1e6, -1e6, 1e6]))
    mine, other = (
        solve_static(deformable(a, named_load("pipe", 0.01).on(a), material=CONCRETE))
        for a in (assembly, away)
    )
    # Coordinates lose 2e-10 mm; at 0.5 MPa the law has 570 MPa/mm: 1e-7 MPa of 0.5 MPa.
    return Finding(
        Check("residual there", other.evidence.residual, 1e-8),
        Check("pressures", relative(other.pressures, mine.pressures), 1e-5),
    )


@CASES.add("incompressible-contact", "ν = 0.4999 with B-bar in a pressed column: equilibrium")
def _incompressible() -> Finding:
    assembly = stack(2)
    rubber = Material(density=2.4e-9, young_modulus=30_000.0, poisson_ratio=0.4999)
    stated = deformable(
        assembly, pressed(assembly, 0.01), material=rubber, element=ElementType.B_BAR
    )
    result = solve_static(stated, StaticOptions(symmetry=1))
    surfaces = stated.surfaces
    force = float((surfaces.weights * result.pressures).sum())
    n_joints = assembly.n_blocks - 1
    carried = n_joints * 0.01 * BRICK[0] * BRICK[1]
    return Finding(
        Check("residual", result.evidence.residual, 1e-8),
        Check("joint forces against the load", relative(force, carried), 1e-7),
    )


@CASES.add(
    "turning-normals",
    "Blocks that turn 0.1 mm before they press: no equilibrium is found, and said",
)
def _turning() -> Finding:
    assembly = tube(2, SineBlockDivisions(12, 2, 4))
    load = named_load("tunnel", 0.01).on(assembly)
    stated = Problem(assembly, load, CONCRETE, clearance=0.1, check_units=False)
    return refusal(
        lambda: static_state(stated.deformable),
        StaticError,
        "no equilibrium found",
        "use an explicit run",
    )


@CASES.add(
    "cell-that-nothing-holds",
    "A periodic cell floats: balance, the same by sector and ring, sparse and condensed",
)
def _floating() -> Finding:
    assembly = HexagonTube(HexagonBlock(4, 120.0, 40.0), HexagonBlockDivisions(4, 2), 2).cell()
    stated = Problem(
        assembly, named_load("tunnel", 0.01).on(assembly), CONCRETE, check_units=False
    ).deformable
    ring, sector, sparse = (
        solve_static(stated, StaticOptions(symmetry=order, method=method))
        for order, method in (
            (1, StaticMethod.CONDENSED),
            (None, StaticMethod.CONDENSED),
            (None, StaticMethod.SPARSE),
        )
    )
    return Finding(
        Check("residual", ring.evidence.residual, 1e-8),
        Check("sector against ring", relative(sector.pressures, ring.pressures), 1e-6),
        Check("sparse against condensed", relative(sparse.pressures, sector.pressures), 1e-4),
    )
