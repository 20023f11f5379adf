"""Robustness cases of convergence orders: first frequency of a cantilever over mesh and time step.

Mesh: four hexahedra with lumped mass against scikit-fem's quadratic hexahedra on a finer mesh.
Time step: the phase of a free vibration in the first mode, run by central differences, against the
eigenfrequency of the same discrete model, so that nothing but the time step errs.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import eigsh

from fem.element.hexahedron import ElementType
from fem.element.kinds import block_lumped_mass, block_stiffness
from fem.element.material import Material
from fem.explicit.setup.timed_system import timed_system
from fem.method import Explicit
from geometry.block import box_block
from geometry.mesh import FloatArray
from validation.stability.case import CaseVerdict, Number, case, case_verdict
from validation.stability.explicit import ended
from validation.stability.problems import held_nodes, one_block

#: Long, slender, and without Poisson's ratio, so that the clamped end has no singular stress.
SIZE = (200.0, 20.0, 20.0)
MATERIAL = Material(density=2.4e-9, young_modulus=33000.0, poisson_ratio=0.0)


def cantilever_frequency(n: int, element: ElementType) -> tuple[float, FloatArray]:
    """First ω [rad/s] and mode (n_nodes, 3) with 10 n × n × n elements, x = 0 clamped."""
    mesh = box_block(SIZE, (10 * n, n, n)).mesh
    free = np.flatnonzero(np.repeat(mesh.nodes[:, 0] > 0.0, 3))
    mass = np.repeat(block_lumped_mass(mesh, MATERIAL.density), 3)[free]
    stiffness = sp.csr_array(block_stiffness(mesh, MATERIAL, element))[free].tocsc()[:, free]
    # K x = ω² M x with lumped mass: an eigenvalue of M^(-1/2) K M^(-1/2).
    root = sp.diags_array(1.0 / np.sqrt(mass))
    start = np.random.default_rng(0).standard_normal(len(mass))
    value, vector = eigsh(sp.csc_matrix(root @ stiffness @ root), k=1, sigma=0.0, v0=start)
    mode = np.zeros(3 * mesh.n_nodes)
    mode[free] = vector[:, 0] / np.sqrt(mass)
    return float(np.sqrt(value[0])), mode.reshape(-1, 3)


def reference_frequency(n: int = 3) -> float:
    """First ω by scikit-fem: quadratic hexahedra, consistent mass [rad/s]."""
    import skfem
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    axes = [np.linspace(0.0, s, k * n + 1) for s, k in zip(SIZE, (10, 1, 1), strict=True)]
    mesh = skfem.MeshHex.init_tensor(*axes)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHex2()), intorder=4)
    lame = lame_parameters(MATERIAL.young_modulus, MATERIAL.poisson_ratio)
    stiffness = linear_elasticity(*lame).assemble(basis)
    inertia = skfem.BilinearForm(lambda u, v, _: MATERIAL.density * skfem.helpers.dot(u, v))
    mass = inertia.assemble(basis)
    held = basis.get_dofs(lambda x: x[0] == 0.0).flatten()
    free = np.setdiff1d(np.arange(basis.N), held)
    start = np.random.default_rng(0).standard_normal(len(free))
    a, m = sp.csc_matrix(stiffness)[free][:, free], sp.csc_matrix(mass)[free][:, free]
    value = eigsh(a, k=1, M=m, sigma=0.0, v0=start, return_eigenvectors=False)
    return float(np.sqrt(value[0]))


def phase_errors(fractions: tuple[float, ...]) -> list[float]:
    """Error of the first frequency for steps over the critical one, by the phase of a free run.

    Started in the first mode the motion is cos(ω t); after a quarter past several periods the
    tip passes zero, where phase = velocity-free displacement over amplitude, (ω - ω_exact) t.
    """
    bar = box_block(SIZE, (20, 2, 2))
    omega, mode = cantilever_frequency(2, ElementType.INCOMPATIBLE)
    held = held_nodes(np.flatnonzero(bar.mesh.nodes[:, 0] == 0.0))
    model = timed_system(one_block(bar, MATERIAL, supports=held), ramp_time=0.0, end_time=1.0)
    start = 1e-3 * mode / np.abs(mode).max()
    # The error of the phase grows with time: six periods make it well larger than round-off.
    periods = 6.25
    end, weight = periods * 2 * np.pi / omega, np.repeat(model.bodies[0].lumped_mass, 3)
    errors = []
    for fraction in fractions:
        released = model.until(end, displacements=(start[None],))
        state, run = ended(released, Explicit(safety_factor=fraction))
        amplitude = float(weight @ (state.displacements[0][0].ravel() * start.ravel()))
        amplitude /= float(weight @ start.ravel() ** 2)
        phase = np.arccos(np.clip(amplitude, -1.0, 1.0)) + 2 * np.pi * np.floor(periods)
        errors.append(float(abs(phase / (omega * run.time) - 1.0)))
    return errors


@case(slow=True)
def order_in_mesh_size() -> CaseVerdict:
    """First frequency of a cantilever over the element size: the error falls in second order.

    Two and four elements through the thickness; an order of 1.7 allows for elements that are
    not in their asymptotic range.
    """
    exact, last, numbers = reference_frequency(), [], list[Number]()
    for element in ElementType:
        values = (cantilever_frequency(n, element)[0] for n in (2, 4))
        before, after = (abs(omega / exact - 1.0) for omega in values)
        numbers.append((f"order of {element.value}", np.log2(before / after), ">=", 1.7))
        last.append(after)
    return case_verdict(*numbers, ("largest error on four elements", max(last), 0.03))


@case()
def order_in_time_step() -> CaseVerdict:
    """Phase of a free vibration over the time step: second order.

    The next term of central differences is smaller by (ω Δt)².
    """
    before, after = phase_errors((0.45, 0.225))
    return case_verdict(("order, off 2", abs(np.log2(before / after) - 2.0), 0.01))
