"""Hertz and Cattaneo–Mindlin on meshes that do not match, within what law and chords can err by.

With k = 3 E*/h and p₀ = E* a / 2R of a roller, two errors of first order are known beforehand. The
law gives way by p₀/k, a share of h/3a of the a²/2R by which the end is flattened. Chords of the two
surfaces cross by h²/8R, which presses k h²/8R, a share of 3h/4a of p₀. Fields err by less than the
sum; of balls, p₀ = 2 E* a / πR*, both are smaller.
"""

import math
import time

import numpy as np
import pytest

from fem import CoulombFriction
from tests.verification.hertz import (
    Bodies,
    Field,
    balls,
    effective_modulus,
    pressed_balls,
    pressed_roller,
    pressed_together,
    pushed_aside,
    roller,
    slipped_roller,
)

#: Stiffness of the law times the edge over E*: it grows as meshes do, so that what the law gives
#: way (a share of h / 3a of the approach) and what chords that cross press by fall with the edge.
LAW = 3.0
#: Elements over the meant contact radius: the edge of the contact lies on edges of both meshes.
CELLS = 25.0 / 6.0
BALL_MESHES = (CELLS, 1.5 * CELLS, 2.0 * CELLS)
ROLLER_MESHES = (CELLS, 2.0 * CELLS, 4.0 * CELLS)
BALL, STEEL, ALUMINIUM, FRICTION = 20e3, 210e3, 70e3, 0.2
#: Half width of the contact of rollers that is meant [mm].
HALF_WIDTH = 2.0


def law_stiffness(young, cell, share):
    """Stiffness of the contact law on a mesh [MPa/mm]."""
    return share * LAW * effective_modulus(young) / cell


def ball_case(cells, approach, share=1.0) -> tuple[Bodies, Field]:
    """Two equal balls, R = 50 mm, E = 20 000 MPa; ``share`` of the law's stiffness."""
    cell = math.sqrt(25.0 * approach) / cells
    law = law_stiffness((BALL, BALL), cell, share)
    bodies = balls(cell, approach=approach, young=BALL, stiffness=law)
    return bodies, pressed_balls(bodies, pressed_together(bodies))


def roller_case(cells, share=1.0) -> tuple[Bodies, Field]:
    """A roller of steel on a block of aluminium, its centre 0.205 mm lower."""
    young, cell = (ALUMINIUM, STEEL), HALF_WIDTH / cells
    law = law_stiffness(young, cell, share)
    bodies = roller(cell, contact=HALF_WIDTH, apart=0.205, young=young, stiffness=law)
    return bodies, pressed_roller(bodies, pressed_together(bodies))


def slip_case(cells, share=1.0) -> tuple[Bodies, Field]:
    """A roller of steel on a block of steel, pressed by 0.198 mm, then pushed 0.045 mm aside."""
    young, cell = (STEEL, STEEL), HALF_WIDTH / cells
    law = law_stiffness(young, cell, share)
    bodies = roller(cell, contact=HALF_WIDTH, apart=0.198, young=young, stiffness=law)
    friction = CoulombFriction(FRICTION, law)
    normal = pressed_together(bodies)
    state = pushed_aside(bodies, normal, 0.045, friction)
    return bodies, slipped_roller(bodies, normal, state, friction)


def law(cells):
    """What the law gives way, over what the end is flattened by."""
    return 1.0 / (3.0 * cells)


def bound(cells):
    """The same, and what chords press over p0."""
    return law(cells) + 3.0 / (4.0 * cells)


def check(found, cells):
    assert found.found_a == pytest.approx(found.a, rel=law(cells))
    assert found.found_p0 == pytest.approx(found.peak, rel=bound(cells))
    assert found.field_error < bound(cells)


def test_a_roller_and_its_order():
    """Two thirds of the edge: the error falls by two thirds, to a tenth."""
    coarse, fine = ROLLER_MESHES[0], 1.5 * ROLLER_MESHES[0]
    errors = []
    for cells in (coarse, fine):
        _, found = roller_case(cells)
        check(found, cells)
        errors.append(found.field_error)
    assert errors[1] < (2.0 / 3.0 + 0.1) * errors[0]


# ---------------------------------------------------------------------------------------------
# The table


PROBLEMS = (
    ("roller R 50 mm of 210 GPa on 70 GPa", roller_case, ROLLER_MESHES, ()),
    ("Cattaneo–Mindlin: roller on its like, μ = 0.2", slip_case, ROLLER_MESHES, ()),
    ("two balls R 50 mm, E 20 GPa, approach 0.16 mm", ball_case, BALL_MESHES, (0.16,)),
    ("two balls, approach 4 mm", ball_case, BALL_MESHES, (4.0,)),
)


def off(found, closed):
    """Difference from the closed form [%]; None where there is none."""
    return 100.0 * (found / closed - 1.0) if closed else None


def rows():
    """Each problem on three meshes and, on the middle one, with half the stiffness of the law."""
    for name, case, meshes, arguments in PROBLEMS:
        errors = []
        for cells, share in [*((cells, 1.0) for cells in meshes), (meshes[1], 0.5)]:
            start = time.process_time()
            bodies, found = case(cells, *arguments, share)
            errors.append(found.field_error)
            row = {
                "problem": name if share == 1.0 else "… half k",
                "a / h": cells,
                "nodes": bodies.deformable.n_nodes,
                "a": off(found.found_a, found.a if found.force else 0.0),
                "p0": off(found.found_p0, found.peak if found.force else 0.0),
                "Q / μP": found.ratio or None,
                "c": off(found.found_c, found.c),
                "field": 100.0 * found.field_error,
            }
            if arguments:
                row |= at_approach(found, *arguments)
            if len(errors) == len(meshes):
                row["order"] = -float(np.polyfit(np.log(meshes), np.log(errors), 1)[0])
            yield row | {"CPU s": time.process_time() - start}


def at_approach(found, approach):
    """What was found, and by how much Hertz at the approach itself has another force [%]."""
    force = 4.0 / 3.0 * effective_modulus((BALL, BALL)) * math.sqrt(25.0 * approach) * approach
    found_at = {"a [mm]": found.found_a, "p0 [MPa]": found.found_p0}
    return found_at | {"F at the approach": off(found.force, force)}
