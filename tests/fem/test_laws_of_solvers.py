"""Laws that hold whichever solver is asked: one table, laws by solvers.

Static answers end at a residual of 1e-8 of the loads, explicit ones at `REST`. The softest motions
of blocks give way by as much as `SOFT` times a residual.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fem import (
    CoulombFriction,
    Explicit,
    ExponentialLaw,
    Frames,
    LinearPenalty,
    Material,
    PairLaws,
    Problem,
    Static,
    concrete,
    solve_explicit,
    solve_static,
)
from fem.answer.answer import answer_of
from fem.answer.forces import (
    energies_of,
    external_work,
    imbalance_of,
    joints_of,
    load_work,
    strain_energy,
)
from fem.answer.pressures import contact_measures
from fem.contact.law import ContactLaw
from fem.explicit.body import world_vectors
from fem.explicit.damping import applied_forces
from fem.explicit.setup.timed_system import timed_system
from fem.explicit.start import prepare
from fem.explicit.timed import TimedSystem
from fem.state import State
from fem.static.linear_step.linearisation import StaticError
from fem.static.solve import StaticOptions, static_state
from geometry import Assembly, HeldFace, LoadCase, PressureLoad, box_block, pipe
from geometry.assembly import moved, renumbered
from geometry.mesh import FloatArray
from geometry.parts.placed import AnyBlocks
from geometry.parts.regions import Plane
from tests.support.assemblies import boxes
from tests.support.blocks import random_rotation
from tests.support.coarse_tubes import ring
from tests.support.fem_problems import still

X, _, Z = np.eye(3)
REST, SOFT = 1e-6, 100.0
GRAVITY = 9810.0
STATIC = Static(mesh="scene", error_estimate=False)
EXPLICIT = Explicit(residual=REST)


@dataclass(frozen=True)
class Solver:
    """How a problem is stated and solved."""

    method: Static | Explicit = STATIC
    stated: Mapping[str, Any] = field(default_factory=dict)
    crossing: bool = False
    """Whether facets of boxes cross each other, so that contact is searched."""
    solids: bool = False
    """Whether boxes are solids, which get their meshes from the problem."""

    @property
    def runs(self) -> bool:
        return isinstance(self.method, Explicit)

    @property
    def exact(self) -> float:
        """Relative error of its answers."""
        return SOFT * (REST if self.runs else 1e-8)

    def solved(self, problem: Problem, *, resume: Path | None = None, **options: Any) -> State:
        """What is found on the mesh of the problem; ``resume``: of a run that is cut short."""
        problem, method = replace(problem, **self.stated), replace(self.method, **options)
        if not self.runs:
            return solve_static(problem, method).details
        if resume is not None:
            cut = solve_explicit(problem, replace(method, max_work=1e-12), checkpoint=resume)
            assert cut.report["status"] == "stopped"
        return solve_explicit(problem, method, resume=resume).details


SOLVERS = {
    "matched": Solver(),
    "searched": Solver(stated={"finite_sliding": True}, crossing=True),
    "degree 2": Solver(stated={"degree": 2}),
    "degree 3": Solver(stated={"degree": 3}),
    "degree 2, searched": Solver(stated={"degree": 2, "finite_sliding": True}, crossing=True),
    "friction": Solver(replace(STATIC, load_steps=1), {"friction": 0.3}),
    "own solids": Solver(stated={"divisions": 2}, solids=True),
    "explicit, paired": Solver(EXPLICIT),
    "explicit, sliding": Solver(EXPLICIT, {"finite_sliding": True}, crossing=True),
}
RUNS = tuple(name for name, solver in SOLVERS.items() if solver.runs)
#: Solvers of which no tube is asked, and why.
NO_TUBE = {
    "own solids": "solids have no sectors: their meshes are no images of each other",
    "degree 3": "half a wave on fewer elements: beside another solver in test_one_answer.py",
    "degree 2, searched": "up to 77 CPU s (2026-11-29); degree and search have all of it each",
}


def cells(without: Mapping[str, str] = {}) -> Any:
    """All solvers but some, which are named with the reason."""
    assert without.keys() <= SOLVERS.keys()
    return pytest.mark.parametrize("name", [name for name in SOLVERS if name not in without])


# ---------------------------------------------------------------------------------------------
# Boxes: uniform stress, balance, limits of the law

EDGE, PLATE, PRESSURE = 20.0, 10.0, 0.5
#: Without lateral strain all is uniform.
CORK = Material(density=2.4e-9, young_modulus=3e4, poisson_ratio=0.0)
SOFTER, STIFFER = LinearPenalty(50.0), LinearPenalty(500.0)
LAWS: dict[str, ContactLaw] = {
    "exponential": ExponentialLaw(),
    "capped": ExponentialLaw(maximum_stiffness=100.0),
    "linear": STIFFER,
    "of pairs": PairLaws(STIFFER, ((2, 0, SOFTER),)),
}
ROUGH, SMOOTH = 0.3, 0.1
FRICTION = CoulombFriction(0.2, of_pairs=((0, 1, ROUGH), (2, 0, SMOOTH)))


def dice(solver: Solver) -> AnyBlocks:
    """Two dice on a plate that is fixed."""
    places = ((0.0, 0.0, 0.0), (10.0, 0.0, PLATE), (60.0, 0.0, PLATE))
    sizes = ((100.0, EDGE, PLATE), (EDGE,) * 3, (EDGE,) * 3)
    if solver.solids:
        spans = ((low, tuple(np.add(low, size))) for low, size in zip(places, sizes, strict=True))
        return boxes(*spans, fixed=1)  # type: ignore[arg-type]
    fine = (3, 3, 2) if solver.crossing else (2, 2, 2)
    meshes = ((10, 2, 1), fine, fine)
    shapes = tuple(
        box_block(size, mesh, name=f"box {k}", contact_faces=("z-", "z+"))
        for k, (size, mesh) in enumerate(zip(sizes, meshes, strict=True))
    )
    return Assembly(
        name="dice",
        shapes=shapes,
        shape_of=np.arange(3),
        rotations=np.tile(np.eye(3), (3, 1, 1)),
        translations=np.array(places),
        layer=np.array([0, 1, 1]),
        fixed=np.array([True, False, False]),
        unmatched_allowed=True,
    )


def on_dice(
    solver: Solver, pressure: float = PRESSURE, *, push: float = 0.0, **stated: Any
) -> Problem:
    """Dice under a pressure, which supports push along x."""
    blocks, tops = dice(solver), PLATE + EDGE
    sides = (10.0, 60.0)
    loads = tuple(
        PressureLoad(np.array([k]), Plane([x, 0.0, tops], Z), pressure)
        for k, x in enumerate(sides, 1)
    )
    held = tuple(
        HeldFace(k, Plane([x, 0.0, PLATE], -X), X[None], push * X)
        for k, x in enumerate(sides, 1)
        if push
    )
    load = LoadCase(blocks, "pressed", loads if pressure else (), np.arange(3) == 0, held)
    return Problem(blocks, load, CORK, **stated)


@cache
def pressed(name: str, law: str, pressure: float = PRESSURE) -> State:
    """Dice under a pressure."""
    return SOLVERS[name].solved(on_dice(SOLVERS[name], pressure, law=LAWS[law]))


@pytest.mark.parametrize("law", LAWS)
@cells()
def test_uniform_stress_passes_and_joints_close_by_the_law(name: str, law: str) -> None:
    """Every point has the pressure of the load, on all of the area; the top of a die sinks by the
    inverse of the law of its joint and by p h / E. The pressure follows from the load."""
    found, exact = pressed(name, law), SOLVERS[name].exact
    points = found.contact_state
    assert points.point_pressures == pytest.approx(PRESSURE, rel=exact)
    assert points.point_areas.sum() == pytest.approx(2.0 * EDGE**2, rel=1e-9)
    for measure in ("p_max", "p_max_point"):
        assert getattr(contact_measures(found), measure) == pytest.approx(PRESSURE, rel=exact)
    strain, contact = PRESSURE**2 / CORK.young_modulus * EDGE**3, 0.0
    for die in (1, 2):
        its = LAWS[law].on(np.array([0]), np.array([die]))
        sink = float(its.overclosure(PRESSURE))
        contact += EDGE**2 * float(its.stored_energy(sink))
        top = found.displacement_of(die)[:, 2].min()
        assert top == pytest.approx(-sink - PRESSURE * EDGE / CORK.young_modulus, rel=exact)
    energies = energies_of(found)
    assert energies is not None
    stored = energies["strain_energy"], energies["contact_energy"]
    assert stored == pytest.approx((strain, contact), rel=10.0 * exact)


def all_moves(state: State) -> FloatArray:
    """Displacements of all nodes, one after the other [mm]."""
    return np.concatenate(state.displacements, axis=None)


@cells()
def test_a_law_that_every_pair_has_is_the_law_of_all(name: str) -> None:
    alike = PairLaws(SOFTER, ((0, 1, STIFFER), (0, 2, STIFFER)))
    found = all_moves(SOLVERS[name].solved(on_dice(SOLVERS[name], law=alike)))
    one = all_moves(pressed(name, "linear"))
    assert np.abs(found - one).max() <= SOLVERS[name].exact * np.abs(one).max()


# ---------------------------------------------------------------------------------------------
# Friction


@pytest.mark.parametrize("rough", [True, False], ids=["of pairs", "of all"])
@cells(dict.fromkeys(RUNS, "supports that end at rest: gravity pushes, below"))
def test_blocks_that_are_pushed_slide_at_the_limit_of_their_joint(name: str, rough: bool) -> None:
    """Supports push by μ N where every point slides, but for normals that turn by less than 1e-4;
    by k u where all stick, half of the way to the lower limit."""
    solver, law = SOLVERS[name], STIFFER
    stick, limits, way = 5.0, (ROUGH, SMOOTH) if rough else (0.2, 0.2), 0.1
    friction = replace(FRICTION if rough else CoulombFriction(0.2), stick_stiffness=stick)
    stated = {"friction": friction, "law": law}
    weight = PRESSURE * EDGE**2
    one = replace(solver, stated={**solver.stated, **stated})
    slid = one.solved(on_dice(solver, push=way), load_steps=1, motion_steps=4)
    assert pushes(slid) == pytest.approx(np.multiply(limits, weight), rel=1e-4)
    lost = np.multiply(limits, weight) @ (way - np.multiply(limits, PRESSURE / stick))
    assert slid.evidence.frictional_dissipation == pytest.approx(lost, rel=0.02)
    little = 0.5 * min(limits) * PRESSURE / stick
    sticks = one.solved(on_dice(solver, push=little), load_steps=1, motion_steps=1)
    # The side that is pushed stays upright; blocks give 1e-2 of what points do that stick.
    assert pushes(sticks) == pytest.approx(stick * little * EDGE**2, rel=0.02)
    assert sticks.evidence.frictional_dissipation == 0.0


def pushes(found: State) -> np.ndarray:
    """Forces of supports on both dice along x [N]."""
    return np.array([forces.reshape(-1, 3)[:, 0].sum() for forces in found.support_forces]).ravel()


@pytest.mark.parametrize("name", RUNS)
def test_blocks_slide_on_where_gravity_leans_beyond_their_limits(name: str) -> None:
    """Blocks of mass m move by ½ (a - μ g) t² and lose μ m g of each way.

    Joints ring with a period of 2π √(ρ h / k) = 6e-5 s about the weight, without opening: the limit
    is μ m g in the mean of each of the 65 periods, and blocks tip a little at first.
    """
    lean, solver = 0.6, SOLVERS[name]
    way = (lean * GRAVITY, 0.0, -GRAVITY)
    stated = on_dice(solver, 0.0, gravity=way, friction=FRICTION, law=STIFFER)
    found = solver.solved(stated, damping="none", ramp_time=0.0, end_time=4e-3)
    run = found.run
    assert run is not None
    slid = np.array([found.displacement_of(k)[:, 0].mean() for k in (1, 2)])
    limits = np.array([ROUGH, SMOOTH])
    assert slid == pytest.approx(0.5 * GRAVITY * (lean - limits) * run.time**2, rel=0.02)
    weight = CORK.density * EDGE**3 * GRAVITY
    lost = run.energies.frictional_dissipation
    assert lost == pytest.approx(weight * limits @ slid, rel=0.02)
    assert run.energy_balance < 1e-3


@cells()
def test_friction_carries_what_leans_up_to_its_limit(name: str) -> None:
    """The weight and its part along the joint are its forces; statics reject a slide, explicit
    blocks slide on."""
    solver = replace(SOLVERS[name], stated={**SOLVERS[name].stated, "friction": SMOOTH})
    weight, steps = CORK.density * EDGE**3 * GRAVITY, {} if solver.runs else {"load_steps": 1}

    def leaning(share: float) -> Problem:
        way = (share * SMOOTH * GRAVITY, 0.0, -GRAVITY)
        return on_dice(solver, 0.0, gravity=way, law=STIFFER)

    joints = joints_of(solver.solved(leaning(0.8), **steps))
    assert joints.normal_force == pytest.approx(weight, rel=solver.exact)
    assert joints.shear_force == pytest.approx(0.8 * SMOOTH * weight, rel=solver.exact)
    if not solver.runs:
        beyond = replace(leaning(1.05), **solver.stated).system
        with pytest.raises(StaticError, match="no equilibrium found"):
            static_state(beyond, StaticOptions(load_steps=1, max_iterations=20))


# ---------------------------------------------------------------------------------------------
# Tubes

LOAD = 0.01


def under(load: float = LOAD, blocks: Assembly | None = None, **stated: Any) -> Problem:
    """A tube under pressure."""
    return Problem(ring(2) if blocks is None else blocks, pipe(load), concrete, **stated)


@cache
def found_by(name: str) -> State:
    """The tube of two layers, with all its symmetry."""
    return SOLVERS[name].solved(under())


def same(one: State, other: State, exact: float) -> None:
    """Displacements of all nodes and pressures agree relative to the largest."""
    a, b = all_moves(one), all_moves(other)
    assert np.abs(a - b).max() <= exact * np.abs(b).max()
    for measure in ("p_eff", "p_max", "p_max_point"):
        value = getattr(contact_measures(other), measure)
        assert getattr(contact_measures(one), measure) == pytest.approx(value, rel=exact)


@cells(NO_TUBE)
def test_joints_and_loads_balance_every_block(name: str) -> None:
    """As printed, and forces of points summed here, to the residual."""
    found = found_by(name)
    points, system = found.contact_state, found.whole
    near = SOFT * found.residual
    assert imbalance_of(found).largest <= near
    forces = system.computed.expand(system.computed.nodal_forces())
    left = np.zeros((system.assembly.n_blocks, 3))
    for block in system.deformable_blocks.tolist():
        left[block] = forces[system.body_number[block]][system.copy_of[block]].sum(axis=0)
    size = np.abs(left).max()
    for side, sign in ((points.block_m, -1.0), (points.block_s, 1.0)):
        np.add.at(left, side[points.facet], sign * points.point_forces)
    assert np.abs(left[system.deformable_blocks]).max() <= near * size


@cells(NO_TUBE | dict.fromkeys(RUNS, "runs measure their balance beside the motion that is left"))
def test_an_answer_whose_forces_do_not_balance_is_rejected(name: str) -> None:
    """A thousandth of the largest joint force is missing: the error names one of its blocks."""
    found = found_by(name)
    state, joints = found.contact_state, joints_of(found)
    largest = int(np.linalg.norm(joints.forces, axis=1).argmax())
    pair = int(joints.block_m[largest]), int(joints.block_s[largest])
    less = np.ones(len(state.facet))
    less[state.joint(*pair)] = 0.999
    wrong = replace(found)
    vars(wrong)["contact_state"] = replace(state, point_pressures=less * state.point_pressures)
    assert 1e-4 < imbalance_of(wrong).force < 1.001e-3  # of the joint or the load, the larger
    with pytest.raises(StaticError, match=f"of block ({pair[0]}|{pair[1]}) are out of balance"):
        answer_of(wrong)


@cells(NO_TUBE)
def test_a_sector_is_the_whole(name: str) -> None:
    """Of two layers one or two blocks are computed in place of eight."""
    found, whole = found_by(name), SOLVERS[name].solved(under(), symmetry="none")
    computed = len(found.system.blocks), len(whole.system.blocks)
    assert computed[0] in (1, 2)
    assert computed[1] == 8
    same(found, whole, SOLVERS[name].exact)
    energies = [energies_of(state) for state in (found, whole)]
    for energy in ("strain_energy", "contact_energy", "external_work", "frictional_dissipation"):
        one, other = (of[energy] for of in energies)
        assert one == pytest.approx(other, rel=SOLVERS[name].exact, abs=0.0), energy


@cells(NO_TUBE)
def test_a_tube_that_stands_elsewhere_otherwise_numbered_is_the_same(name: str) -> None:
    """Turned by any matrix and moved by metres: places of 4e3 mm are rounded by 5e-13 mm, gaps of
    1e-3 mm then by 5e-10. Which of two blocks of a search is cut follows from where they are."""
    turn, blocks = random_rotation(5), ring(2)
    order = np.random.default_rng(3).permutation(blocks.n_blocks)
    there = renumbered(moved(blocks, turn, 1e3 * np.array([3.0, -2.0, 1.0])), order)
    found, here = SOLVERS[name].solved(under(blocks=there)), found_by(name)
    exact, largest = SOLVERS[name].exact, here.largest_displacement
    for block in here.whole.deformable_blocks.tolist():
        new = int(np.flatnonzero(order == block)[0])
        expected = here.displacement_of(block) @ turn.T
        assert np.abs(found.displacement_of(new) - expected).max() <= exact * largest
    for measure in ("p_eff", "p_max_point"):
        value = getattr(contact_measures(here), measure)
        assert getattr(contact_measures(found), measure) == pytest.approx(value, rel=exact)


@cells(NO_TUBE)
def test_a_tube_a_hundred_metres_away_has_the_same_digits(name: str) -> None:
    """Places of 1e5 mm have rounding of 1e-11 mm: a part in 1e8 of the pressure of one point."""
    away = under(blocks=moved(ring(2), np.eye(3), 1e5 * np.array([1.0, -1.0, 1.0])))
    same(SOLVERS[name].solved(away), found_by(name), 1e-8)


# ---------------------------------------------------------------------------------------------
# Work, and on from a state


@cells(NO_TUBE | {"friction": "its work is lost on the way: the limit of friction has it"})
def test_work_of_the_loads_is_what_is_stored(name: str) -> None:
    """On the way to 1 % more load the mean of both loads does it, but for a square of 1e-2; a
    search is renewed on it, which changes areas by 1e-3 of it. Of a run at every sample, where what
    cuts that are renewed make or take is 1e-3 of all."""
    solver, found, more = SOLVERS[name], found_by(name), 0.01
    if found.run is not None:
        assert found.run.energies.external_work > 0.0
        assert found.run.energy_balance < (1e-2 if solver.crossing else 1e-4)
        return
    on = solver.solved(under((1.0 + more) * LOAD))
    way = load_work(on) / (1.0 + more) - load_work(found)
    work = external_work(on) - external_work(found)
    near = 1e-3 if solver.crossing else more**2
    assert work == pytest.approx((1.0 + 0.5 * more) * way, rel=near)


@cells(NO_TUBE | {"friction": "what has slid belongs to the way"})
def test_an_answer_that_goes_on_from_another_is_the_same(name: str, tmp_path: Path) -> None:
    """Runs with friction to the bit; statics from the state of another load."""
    solver = SOLVERS[name]
    if solver.runs:
        rough = replace(solver, stated={**solver.stated, "friction": 0.3})
        short = {"damping": "none", "ramp_time": 1e-4, "end_time": 3e-4}
        whole = rough.solved(under(), **short)
        on = rough.solved(under(), resume=tmp_path / "run.npz", **short)
        assert whole.run.energies.frictional_dissipation > 0.0
        assert on.run.energies == whole.run.energies
        assert np.array_equal(all_moves(on), all_moves(whole))
        return
    stated, found = replace(under(0.5 * LOAD), **solver.stated).system, found_by(name)
    on = static_state(stated, start=found.displacements)
    same(on, solver.solved(under(0.5 * LOAD)), solver.exact)


#: Solvers that agree: explicit runs with statics, a search with pairs where facets follow curves.
AGREE = {
    "explicit, paired": ("matched", 1e-4),
    "explicit, sliding": ("searched", 1e-4),
}


@pytest.mark.parametrize("name", AGREE)
def test_solvers_agree(name: str) -> None:
    other, exact = AGREE[name]
    same(found_by(name), found_by(other), exact)


@pytest.mark.parametrize("name", ["searched", "explicit, sliding", "degree 2, searched"])
def test_a_search_finds_the_pairs_of_facets_that_match(name: str) -> None:
    """Normals of one side in place of the mean of both change the gap of points d apart by d times
    the turn of the normals, 3e-3 mm · 1e-4 of some 3e-3 mm, and the exponential law at most
    tenfold: 1e-3 of every measure."""
    curved = name.startswith("degree 2")
    fine = under(blocks=ring(1, (12, 1, 2) if curved else (12, 2, 4)))
    found = SOLVERS[name].solved(fine)
    matched = SOLVERS["degree 2" if curved else "matched"].solved(fine)
    # Curved facets have other points in a search, with means of their own.
    points = () if curved else ("p_eff", "p_max", "p_max_point", "mean_overclosure")
    for measure in ("force", *points):
        value = getattr(contact_measures(matched), measure)
        assert getattr(contact_measures(found), measure) == pytest.approx(value, rel=1e-3), measure
    assert found.largest_displacement == pytest.approx(matched.largest_displacement, rel=1e-3)
    assert found.contact_state.n_facets == matched.contact_state.n_facets
    assert strain_energy(found) == pytest.approx(strain_energy(matched), rel=1e-3)


def test_loads_do_less_work_where_friction_acts() -> None:
    rough, smooth = found_by("friction"), found_by("matched")
    assert load_work(rough) < load_work(smooth)
    assert rough.evidence.frictional_dissipation > 0.0


@cells(NO_TUBE | dict.fromkeys(RUNS, "nothing acts on a run"))
def test_without_load_the_law_presses_alone(name: str) -> None:
    """With the pressure at zero clearance, almost in balance on a closed surface: overclosures stay
    far below the clearance at zero pressure."""
    found = SOLVERS[name].solved(under(1e-12)).contact_state
    assert np.abs(found.point_overclosures).max() < 1e-3
    assert found.point_pressures.mean() == pytest.approx(1e-4, rel=0.2)


@pytest.mark.parametrize("name", RUNS)
def test_forces_at_any_motion_balance_and_are_the_slope_of_an_energy(name: str) -> None:
    """All blocks deform: forces and moments about current positions vanish to rounding, as no rigid
    motion changes the energy. Central differences err by a square of 1e-4; the areas of cuts, which
    the energy of a search has too, change once it is renewed."""
    stated = replace(under(frames=Frames.DEFORMABLE), **SOLVERS[name].stated)
    model = timed_system(stated.system)
    rng = np.random.default_rng(2)
    place, way = (
        tuple(size * rng.standard_normal((b.n_copies, b.n_nodes, 3)) for b in model.bodies)
        for size in (5e-3, 1e-7)
    )
    for motion in (place, way):
        still(model.system.whole, motion)
    forces, _ = contact_at(model, place)
    total, moment, size, work = np.zeros(3), np.zeros(3), 0.0, 0.0
    for body, force, u, du in zip(model.bodies, forces, place, way, strict=True):
        total += force.sum(axis=(0, 1))
        moment += np.cross(body.reference_positions() + u, force).sum(axis=(0, 1))
        size += np.abs(force).sum()
        work += float((force * du).sum())
    assert size > 100.0
    assert np.abs(total).max() < 1e-13 * size
    assert np.abs(moment).max() < 1e-12 * 400.0 * size
    if SOLVERS[name].crossing:
        return
    ends = [
        contact_at(model, tuple(u + sign * du for u, du in zip(place, way, strict=True)))[1]
        for sign in (-0.5, 0.5)
    ]
    assert ends[0] - ends[1] == pytest.approx(work, rel=1e-4)


def contact_at(model: TimedSystem, displacements: Any) -> tuple[list[np.ndarray], float]:
    """Contact forces on all nodes, world axes [N], and the energy of contact [N mm]."""
    loop = prepare(replace(model, displacements=displacements), time_step=1e-9)
    for body in loop.bodies:
        body.now.applied_force[:] = 0.0
    contact = loop.interactions[0]
    contact.add_force(loop)
    return [world_vectors(body, applied_forces(body)) for body in loop.bodies], contact.energy()
