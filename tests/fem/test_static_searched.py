"""Static states of joints whose facets a search finds: patch test, weight, friction, sector."""

from dataclasses import replace

import numpy as np
import pytest

from fem import CoulombFriction, Frames, LinearPenalty
from fem.contact.normals import ContactNormals
from fem.static import problem as static_problem
from fem.static.linear_step.linearisation import StaticError
from fem.static.solve import StaticMethod, StaticOptions, static_state
from fem.system.rows import SmoothStepAmplitude, joined_rows
from geometry.families.boxes import ColumnBox, box_column
from geometry.loads import face_pressure
from tests.support.fem_problems import deformable_assembly
from tests.support.lone_bodies import fixed_nodes
from tests.support.searched_stack import SIZE, STIFF, stack


def test_facets_that_are_no_polynomials_pass_uniform_stress_nearly():
    """Nodes moved aside by an eighth of an edge make facets whose functions are no polynomials in
    the plane: what points of degree 4 leave falls with the size of pieces, and is below a tenth of
    the 1e-5 of such facets of degree 1 cut by three points. The two rows of points on the outer
    edges see at most three times as much as those inside."""
    options = {"degree": 2, "normals": ContactNormals.REFERENCE}
    rng = np.random.default_rng(1)
    boxes = box_column([ColumnBox(SIZE, (2, 2, 1)), ColumnBox(SIZE, (3, 3, 1))])
    shapes = []
    for shape in boxes.shapes:
        nodes = shape.mesh.nodes.copy()
        low, high = nodes[:, :2].min(axis=0), nodes[:, :2].max(axis=0)
        inner = ((nodes[:, :2] > low + 1e-9) & (nodes[:, :2] < high - 1e-9)).all(axis=1)
        nodes[inner, :2] += rng.uniform(-4.0, 4.0, (int(inner.sum()), 2))
        shapes.append(replace(shape, mesh=replace(shape.mesh, nodes=nodes)))
    boxes = replace(boxes, shapes=tuple(shapes))
    load = face_pressure(boxes, np.array([1]), "z+", 0.5)
    options |= {"law": LinearPenalty(1e3), "frames": Frames.DEFORMABLE}
    model = deformable_assembly(boxes, load, STIFF, finite_sliding=True, **options)
    state = static_state(model).contact_state
    inside = (np.abs(state.positions[:, :2]) < np.array(SIZE[:2]) / 2.0 - 1e-3).all(axis=1)
    assert 0.5 < inside.mean() < 1.0
    assert state.point_pressures[inside] == pytest.approx(0.5, rel=1e-6)
    assert state.point_pressures == pytest.approx(0.5, rel=3e-6)


def test_a_box_that_was_built_aside_and_reference_normals():
    """A smaller box across facets of the larger: force and its moment are the load's. The larger
    one leans by 1e-5: friction keeps the upper one from sliding off, and takes 1e-5 of the load
    along the joint, with an arm of at most its size of 50 mm."""
    friction = CoulombFriction(0.3)
    for normals in ContactNormals:
        sizes = [SIZE, (50.0, 40.0, 30.0)]
        options = {"shift": 7.3, "normals": normals, "friction": friction}
        model = stack((4, 4, 2), (3, 3, 2), sizes=sizes, **options)
        state = static_state(model).contact_state
        force = state.point_forces.sum(axis=0)
        upward = 1.0 if state.block_s[0] == 1 else -1.0
        assert upward * force == pytest.approx([0.0, 0.0, 1000.0], abs=1e-2)
        moment = np.cross(state.positions - [7.3, 0.0, 50.0], upward * state.point_forces)
        assert np.abs(moment.sum(axis=0)).max() < 1e-2 * 50.0


@pytest.mark.parametrize(("divisions", "base"), [(4, 3), (2, 9)])
def test_a_tall_block_stands_up_to_the_edge_of_its_face(divisions, base):
    """Weight W in the middle of 120 mm and a push of W t / 3 there tip a block of 40 mm about its
    edge at t = 1. It stands at 0.98, carried at 20 t from the middle, but for the springs that keep
    loose motions (1e-5), and falls at 1.02, whichever mesh is finer and wherever its lines are."""
    boxes = [ColumnBox((80, 100, 20), (base, base, 1)), ColumnBox((40, 60, 120), 3 * (divisions,))]
    boxes = box_column(boxes)
    for share in (0.98, 1.02):
        model = deformable_assembly(
            boxes,
            face_pressure(boxes, np.array([1]), "z+", 1e-12),
            STIFF,
            law=LinearPenalty(1e3),
            frames=Frames.DEFORMABLE,
            finite_sliding=True,
            friction=CoulombFriction(0.6),
            gravity=9810.0 * np.array([share / 3.0, 0.0, -1.0]),
        )
        if share > 1.0:
            with pytest.raises(StaticError):
                static_state(model)
        else:
            state = static_state(model).contact_state
            force = np.abs(state.point_forces[:, 2])
            middle = float(force @ state.positions[:, 0] / force.sum())
            assert middle == pytest.approx(20.0 * share, rel=1e-3)


def test_blocks_condensed_on_what_points_touch_move_as_one_sparse_matrix(monkeypatch):
    """Inner nodes carry no contact: without them the state is the same, to the residual of 1e-10,
    in stiff blocks pushed close to sliding; and inner nodes follow."""
    gravity = np.array([0.8 * 0.3 * 0.5 * 8000.0 / (2.4e-9 * 4e5), 0.0, 0.0])
    model = stack((5, 5, 5), (4, 4, 6), friction=CoulombFriction(0.3), gravity=gravity)
    options = StaticOptions(load_steps=2, tolerance=1e-10)
    sparse = static_state(model, replace(options, method=StaticMethod.SPARSE))
    monkeypatch.setattr(static_problem, "SparseStep", None)  # another step is taken
    found = static_state(model, options)
    size = sparse.largest_displacement
    for one, other in zip(found.displacements, sparse.displacements, strict=True):
        assert np.abs(one - other).max() < 1e-7 * size
    assert found.pressures.max() == pytest.approx(sparse.pressures.max(), rel=1e-6)


def drawn(model, aside, squeeze=0.02):
    """The lowest of three boxes held, the highest pushed down, the one between drawn aside."""
    ramp, supports = SmoothStepAmplitude(1.0), []
    held = ((2, (0.0, 0.0, 0.0)), (0, (aside, 0.0)), (2, (0.0, 0.0, -squeeze)))
    for block, (axis, way) in enumerate(held):
        along = model.body_of(block).mesh.nodes[:, axis]
        end = along.min() if block == 0 else along.max()
        nodes = np.flatnonzero(np.isclose(along, end))
        moves = {"components": tuple(range(len(way))), "displacement": np.array(way)}
        supports.append(fixed_nodes(block, nodes, **moves, amplitude=ramp))
    return replace(model, supports=joined_rows([held(model.bodies) for held in supports]))


def test_a_box_is_drawn_over_many_facets_out_of_the_channel_between_two_others():
    """Half of it is out after two facets of its neighbours. The area in contact is what is left of
    it, to the elastic strain of 4e-4. On each way of 6 mm Coulomb's law loses no more than mu N of
    its beginning, and no less than mu N of its end, but for the way on which points still stick:
    mu p/k, 1e-2 mm by which the boxes give, and pieces of cut facets that are made on the way (a
    facet in contact is cut once in its way of 20 mm: 1/50 of the way here)."""
    friction = CoulombFriction(0.3)
    model = stack((4, 4, 2), (3, 3, 2), (4, 4, 1), friction=friction, pressure=0.0)
    options = StaticOptions(symmetry=1, method=StaticMethod.SPARSE, motion_steps=None)
    state = static_state(drawn(model, 0.0), options)
    before = state.contact_state.areas @ state.contact_state.pressures
    for aside in np.arange(6.0, 54.1, 6.0):
        state = static_state(drawn(model, aside), options, start=state.displacements)
        found = state.contact_state
        assert found.areas.sum() == pytest.approx(2.0 * 80.0 * (100.0 - aside), rel=4e-4)
        after = found.areas @ found.pressures
        sticks = 0.3 * found.point_pressures.max() / model.stick() + 1e-2 + 6.0 / 50.0
        lost = state.evidence.frictional_dissipation
        assert 0.3 * after * (6.0 - sticks) < lost < 0.3 * before * 6.0
        before = after
