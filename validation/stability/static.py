"""Robustness cases of statics: contrasts, loads and mechanisms between deformable blocks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fem.contact.law import ExponentialLaw
from fem.element.hexahedron import ElementType
from fem.element.material import Material
from fem.problem import Problem, ProblemError
from fem.static.linear_step.linearisation import StaticError
from fem.static.solve import StaticMethod, StaticOptions, static_state
from geometry.assembly import moved
from geometry.families.hexagon_block import HexagonBlock, HexagonBlockDivisions
from geometry.families.sine_block import SineBlockDivisions
from geometry.families.tube import HexagonTube
from geometry.loads import named_load
from validation.stability.case import CaseVerdict, case, case_verdict, rejected
from validation.stability.contact_law import TOLERANCE, pressed_column
from validation.stability.problems import (
    BRICK,
    COLUMN,
    CONCRETE,
    deformable,
    pressed,
    relative_difference,
    stack,
    tsb1_tube,
)


@case()
def stiffness_contrast_1000() -> CaseVerdict:
    """A block 1 000 times stiffer than its neighbour: closed form."""
    pressure, law = 0.01, ExponentialLaw()
    assembly = stack(1)
    stiff = replace(COLUMN, young_modulus=1000.0 * COLUMN.young_modulus)
    stated = deformable(assembly, pressed(assembly, pressure), material=(COLUMN, COLUMN, stiff))
    result = static_state(stated, StaticOptions(tolerance=TOLERANCE, symmetry=1))
    share = pressure * BRICK[2]
    sunk = share / COLUMN.young_modulus + share / stiff.young_modulus
    sunk += 2 * float(law.overclosure(pressure))
    top = -float(result.displacements[1][0, :, 2].min())
    return case_verdict(
        ("residual", result.evidence.residual, TOLERANCE),
        ("joint pressures", relative_difference(result.pressures, np.array(pressure)), 1e-6),
        ("top against the closed form", relative_difference(top, sunk), 1e-6),
    )


@case("load-1e-12-static")
def low_load() -> CaseVerdict:
    """Load of 1e-12 MPa: a pressed column has its closed form."""
    return pressed_column(1e-12)


@case("load-1e4-static")
def high_load() -> CaseVerdict:
    """Load of 1e4 MPa on linear blocks: a pressed column has its closed form."""
    return pressed_column(1e4)


@case("load-1e9-static")
def absurd_load() -> CaseVerdict:
    """Load of 1e9 MPa, a strain of 33 000: rejected where it is stated."""
    return rejected(lambda: pressed_column(1e9), ProblemError, "pressure: got", "expected less")


@case()
def strain_1e4_static() -> CaseVerdict:
    """Blocks so soft that their strain is 11 000: rejected, the motion named."""
    assembly = stack(1)
    soft = replace(COLUMN, young_modulus=3e-5 * COLUMN.young_modulus)
    stated = deformable(assembly, pressed(assembly, 1e4))
    softer = replace(stated, bodies=tuple(replace(b, material=soft) for b in stated.bodies))
    words = ("block lengths", "expected")
    return rejected(lambda: static_state(softer, StaticOptions(symmetry=1)), StaticError, *words)


@case()
def zero_load_static() -> CaseVerdict:
    """No load between fixed rows: equilibrium of touching surfaces."""
    assembly = stack(2, top_fixed=True)
    empty = replace(pressed(assembly, 0.0), faces=())
    result = static_state(deformable(assembly, empty), StaticOptions(symmetry=1))
    # Surfaces press a little where they just touch; nothing can press more than that.
    touching = float(ExponentialLaw().pressure(0.0))
    return case_verdict(
        ("residual", result.evidence.residual, 1e-8),
        ("largest pressure [MPa]", float(result.pressures.max()), touching * 1.000001),
    )


@case()
def mechanism_driven_static() -> CaseVerdict:
    """A column pushed sideways, nothing resists: rejected."""
    assembly = stack(2)
    stated = deformable(assembly, pressed(assembly, 0.01, face="inner"))
    return rejected(
        lambda: static_state(stated, StaticOptions(symmetry=1)), StaticError, "expected"
    )


@case()
def offset_1e6_mm_static() -> CaseVerdict:
    """The tube 1e6 mm from the origin: same pressures."""
    assembly = tsb1_tube(1)
    away = moved(assembly, np.eye(3), np.array([1e6, -1e6, 1e6]))
    mine, other = (
        static_state(deformable(a, named_load("pipe", 0.01).on(a), material=CONCRETE))
        for a in (assembly, away)
    )
    # Coordinates lose 2e-10 mm; at 0.5 MPa the law has 570 MPa/mm: 1e-7 MPa of 0.5 MPa.
    return case_verdict(
        ("residual there", other.evidence.residual, 1e-8),
        ("pressures", relative_difference(other.pressures, mine.pressures), 1e-5),
    )


@case()
def incompressible_contact() -> CaseVerdict:
    """ν = 0.4999 with B-bar in a pressed column: equilibrium."""
    assembly = stack(2)
    rubber = Material(density=2.4e-9, young_modulus=30_000.0, poisson_ratio=0.4999)
    load, element = pressed(assembly, 0.01), ElementType.B_BAR
    stated = deformable(assembly, load, material=rubber, element=element)
    result = static_state(stated, StaticOptions(symmetry=1))
    force = float((stated.surfaces.weights * result.pressures).sum())
    carried = (assembly.n_blocks - 1) * 0.01 * BRICK[0] * BRICK[1]
    return case_verdict(
        ("residual", result.evidence.residual, 1e-8),
        ("joint forces against the load", relative_difference(force, carried), 1e-7),
    )


@case()
def turning_normals() -> CaseVerdict:
    """Blocks that turn 0.1 mm before they press: no equilibrium is found, and said."""
    assembly = tsb1_tube(2, SineBlockDivisions(12, 2, 4))
    load = named_load("tunnel", 0.01).on(assembly)
    stated = Problem(assembly, load, CONCRETE, clearance=0.1, check_units=False)
    words = ("no equilibrium found", "use an explicit run")
    return rejected(lambda: static_state(stated.system), StaticError, *words)


@case()
def cell_that_nothing_holds() -> CaseVerdict:
    """A periodic cell floats: balance, the same by sector and ring, sparse and condensed."""
    assembly = HexagonTube(HexagonBlock(4, 120.0, 40.0), HexagonBlockDivisions(4, 2), 2).cell()
    load = named_load("tunnel", 0.01).on(assembly)
    stated = Problem(assembly, load, CONCRETE, check_units=False).system
    condensed = StaticOptions(method=StaticMethod.CONDENSED)
    ring = static_state(stated, replace(condensed, symmetry=1))
    sector = static_state(stated, condensed)
    sparse = static_state(stated, StaticOptions(method=StaticMethod.SPARSE))
    return case_verdict(
        ("residual", ring.evidence.residual, 1e-8),
        ("sector against ring", relative_difference(sector.pressures, ring.pressures), 1e-6),
        ("sparse against condensed", relative_difference(sparse.pressures, sector.pressures), 1e-4),
    )
