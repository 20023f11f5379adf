"""Condensation, chains of saddle-point blocks and sparse solvers against dense algebra."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array, diags_array, eye_array, kron
from scipy.sparse.linalg import splu

from fem import ElementType, Material, Problem, Static, solve_static
from fem.static.linear_step import condensation
from fem.static.linear_step import linearisation as sparse_solver
from fem.static.linear_step.block_tridiagonal import (
    Leaning,
    Level,
    UnresistedMotionError,
    factor_chain,
)
from fem.static.linear_step.condensation import block_motions, condense
from fem.static.linear_step.linearisation import SparseSolver, SparseSolverError, factorize, fill_in
from fem.system.body import placed_body
from geometry import Assembly
from geometry.block import box_block
from geometry.files.hexahedral_solids import hexahedral_block
from geometry.loads import LoadCase
from geometry.machine.work import LimitError, Operation, budget
from geometry.mesh import HexMesh
from tests.support.answers import PLAIN

pytestmark = pytest.mark.quick


@pytest.fixture(scope="module", params=[ElementType.INCOMPATIBLE, ElementType.REDUCED])
def distorted(request):
    box = box_block((10.0, 8.0, 6.0), (6, 4, 3))
    nodes = box.mesh.nodes + 0.2 * np.random.default_rng(0).standard_normal(box.mesh.nodes.shape)
    return placed_body(
        HexMesh(nodes, box.mesh.elements),
        Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2),
        element=request.param,
    ), np.unique(np.concatenate([box.faces["z+"], box.faces["x-"]]))


def test_condensation_is_the_schur_complement(distorted, monkeypatch):
    """Dense elimination loses some units of eps times the condition of K_ii, 1e3 here: 1e-12."""
    group, retained = distorted
    monkeypatch.setattr(condensation, "_LEAF_ELEMENTS", 5)
    block = condense(group, retained)
    kept = block.degrees_of_freedom
    inner = np.setdiff1d(np.arange(3 * group.n_nodes), kept)
    full = group.stiffness.toarray()
    inside = full[np.ix_(inner, inner)]
    schur = full[np.ix_(kept, kept)] - full[np.ix_(kept, inner)] @ np.linalg.solve(
        inside, full[np.ix_(inner, kept)]
    )
    assert np.abs(block.stiffness - schur).max() < 1e-12 * np.abs(schur).max()
    # A rigid motion costs nothing.
    motion = block_motions(group, retained)
    assert np.abs(block.stiffness @ motion).max() < 1e-11 * np.abs(schur).max()


def test_condensed_forces_and_recovery_invert_each_other(distorted):
    """Forces K u condense to S u_c, and u is recovered, for several copies at once."""
    group, retained = distorted
    block = condense(group, retained)
    u = np.random.default_rng(1).standard_normal((3, group.n_nodes, 3))
    f = np.array([(group.stiffness @ v.ravel()).reshape(-1, 3) for v in u])
    given = f.copy()
    on_retained, reduced = block.condense_forces(f)
    assert (f == given).all()
    u_c = u.reshape(3, -1)[:, block.degrees_of_freedom]
    scale = np.abs(block.stiffness).max()
    assert np.abs(on_retained - u_c @ block.stiffness).max() < 1e-11 * scale
    assert np.abs(block.recover(u_c, reduced) - u).max() < 1e-11


def random_chain(sizes, motions, seed=2):
    """A positive definite A and random C and τ with chain coupling; levels, sides, solution."""
    random = np.random.default_rng(seed)
    n, m = sum(sizes), sum(motions)
    start = np.concatenate([[0], np.cumsum(sizes)])
    first = np.concatenate([[0], np.cumsum(motions)])
    shared = [size // 2 for size in sizes]
    a = np.zeros((n, n))
    c = np.zeros((n, m))
    held = 0.1 * np.eye(m)
    for k in range(len(sizes)):
        low = start[k] if k == 0 else start[k] - shared[k - 1]
        rows = random.standard_normal((start[k + 1] - low, start[k + 1] - low))
        a[low : start[k + 1], low : start[k + 1]] += rows @ rows.T
        wide = random.standard_normal((start[k + 1] - low, motions[k]))
        c[low : start[k + 1], first[k] : first[k + 1]] = wide
        if k:
            across = 0.1 * random.standard_normal((motions[k - 1], motions[k]))
            held[first[k - 1] : first[k], first[k] : first[k + 1]] = across
            held[first[k] : first[k + 1], first[k - 1] : first[k]] = across.T
    d, e = random.standard_normal(n), random.standard_normal(m)
    levels, sides = [], []
    for k in range(len(sizes)):
        own, mine = slice(start[k], start[k + 1]), slice(first[k], first[k + 1])
        last = k + 1 == len(sizes)
        cut = start[k + 1] - shared[k]
        after = slice(n, n) if last else slice(start[k + 1], start[k + 2])
        moving = slice(m, m) if last else slice(first[k + 1], first[k + 2])
        levels.append(
            Level(
                flexibility=np.asfortranarray(a[own, own]),
                motions=c[own, mine].copy(),
                holding=0.1 * np.eye(motions[k]),
                first_shared=sizes[k] - shared[k],
                next_flexibility=a[cut : start[k + 1], after].copy(),
                next_motions=c[cut : start[k + 1], moving].copy(),
                next_holding=held[mine, moving].copy(),
            )
        )
        sides.append((d[own], e[mine]))
    matrix = np.block([[a, -c], [-c.T, -held]])
    return levels, sides, np.linalg.solve(matrix, np.concatenate([d, e]))


def test_chain_is_the_dense_solution():
    """Condition numbers below 1e5 lose five digits of sixteen at most; factors serve again."""
    levels, sides, expected = random_chain([6, 9, 4, 7], [3, 2, 0, 3])
    factor = factor_chain(levels)
    for share in (1.0, -2.0):
        solved = factor.solve([(share * d, share * e) for d, e in sides])
        found = np.concatenate([q for q, _ in solved] + [alpha for _, alpha in solved])
        assert np.abs(found - share * expected).max() < 1e-10 * np.abs(share * expected).max()


def test_a_chain_whose_forces_lean_is_the_dense_solution():
    """The forces of sliding points are C' α and A' q where they are felt as C α and A q."""
    felt, sides, _ = random_chain([6, 9, 4, 7], [3, 2, 0, 3])
    levels = []
    for k, level in enumerate(felt):
        lean = np.random.default_rng(k)
        after = felt[k + 1].motions.shape if k + 1 < len(felt) else (0, 0)
        shared = len(level.motions) - level.first_shared
        done = Leaning(
            motions=level.motions + 0.3 * lean.standard_normal(level.motions.shape),
            next_flexibility=0.3 * lean.standard_normal((after[0], shared)),
            next_motions=level.next_motions + 0.3 * lean.standard_normal((shared, after[1])),
        )
        levels.append(replace(level, leaning=done))
    matrix = dense_chain(levels)
    sizes = [len(level.motions) + level.motions.shape[1] for level in levels]
    expected = np.linalg.solve(matrix, np.concatenate([np.concatenate(side) for side in sides]))
    found = factor_chain(levels).solve(sides)
    assert sum(sizes) == len(expected)
    solved = np.concatenate([np.concatenate(side) for side in found])
    assert np.abs(solved - expected).max() < 1e-9 * np.abs(expected).max()


def dense_chain(levels):
    """The matrix of leaning levels, forces and motions of each level together."""
    rows = [[None] * len(levels) for _ in levels]
    for k, level in enumerate(levels):
        n, m = level.motions.shape
        done = level.leaning
        rows[k][k] = np.block(
            [[level.flexibility, -level.motions], [-done.motions.T, -level.holding]]
        )
        if k + 1 == len(levels):
            continue
        n_next, m_next = levels[k + 1].motions.shape
        upper = np.zeros((n + m, n_next + m_next))
        upper[level.first_shared : n] = np.hstack([level.next_flexibility, -level.next_motions])
        lower = np.zeros((n_next + m_next, n + m))
        lower[:, level.first_shared : n] = np.vstack([done.next_flexibility, -done.next_motions.T])
        upper[n:, n_next:], lower[n_next:, n:] = -level.next_holding, -level.next_holding.T
        rows[k][k + 1], rows[k + 1][k] = upper, lower
    return np.block(
        [
            [
                np.zeros((len(row[i]), len(rows[j][j]))) if cell is None else cell
                for j, cell in enumerate(row)
            ]
            for i, row in enumerate(rows)
        ]
    )


def test_a_motion_without_resistance_is_named():
    levels, _, _ = random_chain([6, 5], [2, 2])
    levels[1].motions[:, 1] = 0.0
    levels[0].next_motions[:, 1] = 0.0
    levels[0].next_holding[:, 1] = 0.0
    levels[1].holding[1, 1] = 0.0
    with pytest.raises(UnresistedMotionError, match="level 1") as caught:
        factor_chain(levels)
    assert np.abs(caught.value.motion).argmax() == 1


def spd(n=40):
    rows = np.random.default_rng(3).standard_normal((n, n))
    return rows @ rows.T + n * np.eye(n)


@pytest.mark.parametrize("solver", [None, *SparseSolver])
def test_sparse_solvers_solve(solver):
    """Condition number of about five: a few units of eps."""
    if solver is SparseSolver.PARDISO:
        pytest.importorskip("pypardiso")
    matrix, right = spd(), np.arange(40.0)
    solution = factorize(csr_array(matrix), solver)(right)
    assert solution == pytest.approx(np.linalg.solve(matrix, right), rel=1e-12, abs=1e-13)


def of_a_chain(n: int, width: int) -> csr_array:
    """Matrix of a chain of groups of so many unknowns; its elimination fills nothing in."""
    each = diags_array([-1.0, 4.0 * width, -1.0], offsets=[-1, 0, 1], shape=(n, n))
    return csr_array(kron(each, np.ones((width, width))) + 9.0 * eye_array(n * width))


def test_fill_is_known_before_a_matrix_is_factored():
    """Of a chain to the last entry; of a solid by another order of elimination, never far below."""
    n, width = 20, 3
    entries = n * width * (width + 1) + 2 * (n - 1) * width**2
    assert fill_in(of_a_chain(n, width)) == pytest.approx(entries, rel=1e-12)
    solid = kron(kron(of_a_chain(8, 1), of_a_chain(8, 1)), of_a_chain(8, 3)).tocsc()
    factor = splu(solid, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    assert 0.9 * factor.nnz < fill_in(csr_array(solid)) < 2.0 * factor.nnz


def test_a_factor_beyond_the_limit_of_memory_is_not_begun():
    matrix = of_a_chain(200, 3)
    with budget() as enough:
        factorize(matrix, SparseSolver.SUPERLU)
    need = enough.bytes / 2**30
    with budget(memory=1.001 * need):
        factorize(matrix, SparseSolver.SUPERLU)
    assert enough.done[Operation.SPARSE] > 0.0
    assert enough.stopped_by is None
    with (
        budget(memory=0.999 * need) as less,
        pytest.raises(LimitError, match="factors of 600 unknowns need"),
    ):
        factorize(matrix, SparseSolver.SUPERLU)
    assert not less.done
    assert less.stopped_by == "memory"


def test_a_missing_library_says_so(monkeypatch):
    def missing(name):
        raise ImportError(f"No module named {name!r}")

    monkeypatch.setattr(sparse_solver, "import_module", missing)
    sparse_solver._pardiso_library.cache_clear()
    with pytest.raises(SparseSolverError, match="choose superlu"):
        factorize(csr_array(spd()), SparseSolver.PARDISO)
    sparse_solver._pardiso_library.cache_clear()


@pytest.mark.parametrize("solver", list(SparseSolver))
def test_a_singular_matrix_is_refused(solver):
    if solver is SparseSolver.PARDISO:
        pytest.importorskip("pypardiso")
    matrix = np.diag(np.append(np.ones(5), 0.0))
    matrix[5, 4] = matrix[4, 5] = -1.0
    matrix[4, 4] = 0.0
    matrix[4:, 4:] = [[1.0, -1.0], [-1.0, 1.0]]
    with pytest.raises(SparseSolverError, match="held"):
        factorize(csr_array(matrix), solver)(np.ones(6))


def test_nodes_where_facets_match_are_retained_and_memory_is_counted():
    """Two cubes with contact on all sides touch at 3 × 3 nodes; a small machine rejects them."""
    cube = hexahedral_block("cube", box_block((100.0, 100.0, 100.0), (2, 2, 2)).mesh)
    assembly = Assembly(
        name="cubes",
        shapes=(cube,),
        shape_of=np.zeros(2, dtype=np.int64),
        rotations=np.stack([np.eye(3)] * 2),
        translations=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 100.0]]),
        layer=np.arange(2),
        fixed=np.array([True, False]),
        unmatched_allowed=True,
    )
    load = LoadCase(assembly, "weight", (), assembly.fixed.copy())
    stone = Material(density=2.4e-9, young_modulus=33e3, poisson_ratio=0.2)
    problem = Problem(assembly, load, stone, gravity=(0.0, 0.0, -9810.0))
    assert solve_static(problem, PLAIN)["max_displacement"].value > 0.0
    with pytest.raises(LimitError, match="16 contact points, and blocks with up to 9 nodes"):
        solve_static(problem, Static(mesh="scene", max_memory=1e-6))
