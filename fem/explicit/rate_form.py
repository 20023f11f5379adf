"""The rate form of Abaqus/Explicit's C3D8R: current gradients, Jaumann rate, hourglass control.

The slow like-for-like beside the co-rotated stiffness of a block: nothing is linearised about
the block, every element follows its own motion. One step from t to t + dt, with the velocity v
at the half step and the averaged gradients B of Flanagan and Belytschko (1981,
doi:10.1002/nme.1620170504):

- increments at the mid-step configuration x(t + dt) - dt v / 2: G = dt v Bᵀ, strain
  e = sym G, spin w = skew G (second order in dt; no strain at all in a rigid rotation);
- stress by the **Jaumann** rate, integrated as Hughes and Winget (1980,
  doi:10.1002/nme.1620151210): s <- R s Rᵀ + C : e, R = (I - w/2)⁻¹ (I + w/2). Abaqus/Explicit
  uses Jaumann for its built-in elasticity (Green-Naghdi only for VUMAT and a few others);
- hourglass forces Q_m <- R Q_m + C_h gamma_m · dt v, C_h and gamma_m of `fem.element.hexahedron`;
- bulk viscosity, a pressure that is no part of the stress (Abaqus, *Explicit dynamic
  analysis*): s_b = xi rho c_d L_e tr D, xi = b1 - b2² (L_e / c_d) min(0, tr D);
- stiffness-proportional damping, beta C : D, no part of the stress either;
- nodal forces V B (s + damping) + sum_m gamma_m Q_m in the configuration at t + dt.

L_e, rho and c_d are those of the reference configuration: strains of elastic solids are small.
Arrays: positions (n_nodes, 3, n_copies), copies of one mesh as lanes; a lone body has one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fem.element.hexahedron import (
    HOURGLASS_SCALE,
    gauss_gradients,
    hourglass_coefficient,
    hourglass_shape,
    mean_gradients,
)
from fem.element.material import Material
from fem.explicit.kernels.rate_form import rate_form_step
from fem.problem.time_step import characteristic_length
from geometry.errors import RefusedError
from geometry.mesh import FloatArray, HexMesh, IntArray, check_mesh


class RateFormError(RefusedError):
    """Input the rate form cannot use: got, expected."""


@dataclass(frozen=True)
class RateFormModel:
    """What is constant.

    Raises
    ------
    RateFormError
        A coefficient that is negative or not finite.
    MeshError
        See `geometry.mesh.check_mesh`.
    """

    mesh: HexMesh
    """Reference configuration, stress-free."""
    material: Material
    """Elastic constants and density."""
    linear_bulk_viscosity: float | None = None
    """Abaqus' b1, there 0.06 by default; None: off."""
    quadratic_bulk_viscosity: float | None = None
    """Abaqus' b2, there 1.2 by default; None: off."""
    stiffness_damping: float | None = None
    """beta of Rayleigh damping [s]; None: off."""
    hourglass_scale: float = HOURGLASS_SCALE
    """See `fem.element.hexahedron.HOURGLASS_SCALE`."""

    def __post_init__(self) -> None:
        check_mesh(self.mesh)
        for name in (
            "linear_bulk_viscosity",
            "quadratic_bulk_viscosity",
            "stiffness_damping",
            "hourglass_scale",
        ):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value >= 0.0):
                raise RateFormError(f"{name}: got {value}; expected a finite number >= 0")

    @property
    def elements(self) -> IntArray:
        """(n_elements, 8)."""
        return self.mesh.elements

    @cached_property
    def length(self) -> FloatArray:
        """Characteristic length of each element in the reference configuration, (n_elements,)."""
        return characteristic_length(self.mesh.nodes[self.mesh.elements])


@dataclass(frozen=True)
class RateFormState:
    """What evolves; `internal_force` writes into these arrays."""

    stress: FloatArray
    """Cauchy stress in world axes, (n_elements, 3, 3, n_copies) [MPa]."""
    hourglass: FloatArray
    """Generalised hourglass forces, (n_elements, 4, 3, n_copies) [N]."""
    work: FloatArray
    """Work done so far on stress, hourglass control, bulk viscosity and stiffness damping,
    (4, n_copies) [mJ]: strain energy, hourglass energy and two dissipations."""


def initial_state(model: RateFormModel, n_copies: int = 1) -> RateFormState:
    """Stress-free state of ``n_copies`` copies."""
    n_elements = len(model.elements)
    return RateFormState(
        stress=np.zeros((n_elements, 3, 3, n_copies)),
        hourglass=np.zeros((n_elements, 4, 3, n_copies)),
        work=np.zeros((4, n_copies)),
    )


def internal_force(
    model: RateFormModel,
    state: RateFormState,
    position: FloatArray,
    velocity: FloatArray,
    time_step: float,
) -> FloatArray:
    """Advance the stresses by one step and return the internal nodal forces at its end.

    Parameters
    ----------
    model
        What is constant.
    state
        At the start of the step; its arrays are advanced to the end.
    position
        Nodes at the end of the step, (n_nodes, 3, n_copies) [mm].
    velocity
        At the half step, such that ``position - time_step * velocity`` is where the step
        began, (n_nodes, 3, n_copies) [mm/s].
    time_step
        [s]

    Returns
    -------
    FloatArray
        (n_nodes, 3, n_copies) [N]; the equation of motion is M a = external - internal.

    Raises
    ------
    RateFormError
        Arrays whose shapes do not fit together.
    """
    expected = (position.shape[0], 3, state.work.shape[1])
    if position.shape != expected or velocity.shape != expected:
        raise RateFormError(
            f"rate form: got positions {position.shape} and velocities {velocity.shape}; "
            f"expected both {expected}"
        )
    material = model.material
    force = np.zeros_like(position)
    rate_form_step(
        model.elements,
        position,
        velocity,
        time_step,
        material.lame_modulus,
        material.shear_modulus,
        model.hourglass_scale,
        model.length / material.dilatational_wave_speed,
        model.linear_bulk_viscosity,
        model.quadratic_bulk_viscosity,
        model.stiffness_damping,
        state.stress,
        state.hourglass,
        state.work,
        force,
    )
    return force


def internal_force_reference(
    model: RateFormModel,
    state: RateFormState,
    position: FloatArray,
    velocity: FloatArray,
    time_step: float,
) -> FloatArray:
    """Plain NumPy statement of `internal_force`, formula by formula; same arguments.

    Slow and short: the kernel is tested against it on random arrays.
    """
    force = np.zeros_like(position)
    for copy in range(position.shape[2]):
        end = position[model.elements, :, copy]
        increment = time_step * velocity[model.elements, :, copy]
        middle = end - 0.5 * increment
        mean, volume = mean_gradients(*gauss_gradients(middle))
        gradient = np.swapaxes(increment, 1, 2) @ mean
        strain = 0.5 * (gradient + np.swapaxes(gradient, 1, 2))
        half_spin = 0.25 * (gradient - np.swapaxes(gradient, 1, 2))
        rotation = np.linalg.solve(np.eye(3) - half_spin, np.eye(3) + half_spin)

        old = state.stress[..., copy].copy()
        new = rotation @ old @ np.swapaxes(rotation, 1, 2) + _hooke(model.material, strain)
        state.stress[..., copy] = new
        state.work[0, copy] += 0.5 * np.einsum("e,eij,eij->", volume, old + new, strain)

        stretch = np.swapaxes(hourglass_shape(middle, mean), 1, 2) @ increment
        coefficient = hourglass_coefficient(mean, volume, model.material, model.hourglass_scale)
        turned = np.einsum("eij,emj->emi", rotation, state.hourglass[..., copy])
        hourglass = turned + coefficient[:, None, None] * stretch
        state.hourglass[..., copy] = hourglass
        state.work[1, copy] += 0.5 * np.einsum("emi,emi->", turned + hourglass, stretch)

        bulk = _bulk_viscosity(model, strain, time_step)
        state.work[2, copy] += np.einsum("e,eij,eij->", volume, bulk, strain)
        damping = (model.stiffness_damping or 0.0) * _hooke(model.material, strain / time_step)
        state.work[3, copy] += np.einsum("e,eij,eij->", volume, damping, strain)

        mean, volume = mean_gradients(*gauss_gradients(end))
        corner = volume[:, None, None] * (mean @ (new + bulk + damping))
        corner += hourglass_shape(end, mean) @ hourglass
        np.add.at(force[..., copy], model.elements, corner)
    return force


def _hooke(material: Material, strain: FloatArray) -> FloatArray:
    """Stress of strains (n, 3, 3)."""
    trace = np.trace(strain, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    return material.lame_modulus * trace + 2.0 * material.shear_modulus * strain


def _bulk_viscosity(model: RateFormModel, strain: FloatArray, time_step: float) -> FloatArray:
    """Viscous pressure xi rho c_d L_e tr D as a stress, (n_elements, 3, 3) [MPa]."""
    speed = model.material.dilatational_wave_speed
    rate = np.trace(strain, axis1=1, axis2=2) / time_step
    ratio = (model.linear_bulk_viscosity or 0.0) - (
        (model.quadratic_bulk_viscosity or 0.0) ** 2
    ) * model.length / speed * np.minimum(rate, 0.0)
    pressure = ratio * model.material.density * speed * model.length * rate
    return pressure[:, None, None] * np.eye(3)
