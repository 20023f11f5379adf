"""What the paper prints and cannot mean, each with a computation that shows it."""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import partial
from typing import Any

import numpy as np
import scipy.optimize
import scipy.sparse as sp

from geometry import RefusedError, SineBlock
from mbd import contact_jacobian
from validation import load_case, solve
from validation.paper.evidence import FloatArray, PaperEvidence, block_of_tube, p_max
from validation.paper.reading import INGREDIENTS, reading_variants
from validation.paper.reference import reference
from validation.paper.verdict import ClaimVerdict, Judge, Statements, Truth
from validation.statement import chosen_by_name

#: In the order of their demonstrations.
ERRATA = Statements("erratum")
#: What an erratum is shown by: a number in words, and as data.
shown = partial(ClaimVerdict, Truth.TRUE)


def solve_printed_program(transpose: sp.csr_array) -> tuple[float, float]:
    """Solve eq. kinematic-feasibility-lp exactly as printed, in HiGHS.

    max 1ᵀs s.t. Gᵀδq ≥ 0, -s ≤ δq ≤ s, 0 ≤ s ≤ 1, of Gᵀ, (n_contacts, 6 N_b): z* and the largest
    |δq| of the optimum found.
    """
    n_contacts, n = transpose.shape
    one = sp.eye_array(n, format="csr")
    above = sp.vstack(
        [
            sp.hstack([-transpose, sp.csr_array((n_contacts, n))]),
            sp.hstack([one, -one]),
            sp.hstack([-one, -one]),
        ]
    )
    solution = _most(n, n, A_ub=sp.csc_array(above), b_ub=np.zeros(above.shape[0]))
    return -float(solution.fun), float(np.abs(solution.x[:n]).max())


def solve_corrected_program(transpose: sp.csr_array) -> float:
    """Find whether a motion opens a contact: max 1ᵀw, w = Gᵀδq, 0 ≤ w ≤ 1."""
    n_contacts, n = transpose.shape
    equal = sp.hstack([transpose, -sp.eye_array(n_contacts)])
    return -float(_most(n, n_contacts, A_eq=sp.csc_array(equal), b_eq=np.zeros(n_contacts)).fun)


def _most(n: int, n_bounded: int, **constraints: Any) -> Any:
    """Maximise the sum of the variables from 0 to 1 that follow n free ones, in HiGHS."""
    solution = scipy.optimize.linprog(
        np.concatenate([np.zeros(n), -np.ones(n_bounded)]),
        bounds=[(None, None)] * n + [(0.0, 1.0)] * n_bounded,
        method="highs",
        **constraints,
    )
    if not solution.success:
        raise RuntimeError(f"HiGHS could not solve a linear program: {solution.message}")
    return solution


@ERRATA.add
def _degenerate_program(_: PaperEvidence) -> ClaimVerdict:
    settings = ["assembly.layers=2", "mesh.around=24", "mesh.radial=3", "mesh.axial=6"]
    case = load_case("tsb1-pipe", settings, method="rigid")
    contacts = contact_jacobian(case.problem.blocks)
    n = 6 * len(contacts.free_blocks)
    transpose = sp.csr_array(contacts.jacobian.to_matrix().T)
    optimum, motion = solve_printed_program(transpose)
    opening = solve_corrected_program(transpose)
    mechanism = solve(case).details.mechanism
    return shown(
        f"TSB1, two layers, N_b = {n // 6}: HiGHS finds z* = {optimum:g} = 6 N_b with "
        f"max |δq| = {motion:.1e}; the corrected program gives {abs(opening):.1e}: {mechanism}",
        {"z": optimum, "6 N_b": n, "largest_motion": motion, "corrected": opening},
    )


def _radii(evidence: PaperEvidence) -> str:
    """Say how far from the axis both points of a block lie."""
    run = evidence.case("TSB1", "shaft")
    blocks, block = run.details.blocks, int(run.details.load.block[0])
    surface = blocks.nodes(block)[blocks.shape(block).surface_nodes]
    points = surface.mean(axis=0), blocks.centroids[block]
    mean, mass = (float(np.hypot(*point[:2])) for point in points)
    return f"in TSB1 they are {mean:.1f} and {mass:.1f} mm from the axis"


def _without(name: str) -> Judge:
    """Show an ingredient of the reading by the tables without it."""

    def show(evidence: PaperEvidence) -> ClaimVerdict:
        whole, without = reading_variants(evidence.rigid, [name])
        moved = without.moved(whole)
        among = moved or without.differences
        place, error = max(among.items(), key=lambda item: abs(item[1]))
        more = f"; {_radii(evidence)}" if name == "shaft-point" else ""
        return shown(
            f"without this assumption {without.to_the_digit} instead of {whole.to_the_digit} of "
            f"{whole.of} values agree to the last digit: it moves {len(moved)}, {place} from "
            f"{100 * whole.differences[place]:+.1f} to {100 * error:+.1f} % off{more}",
            {"with": asdict(whole), "without": asdict(without), "moved": moved},
        )

    return show


for _name in INGREDIENTS:
    ERRATA.add(_without(_name), _name)


def _wave(block: SineBlock, across: FloatArray) -> FloatArray:
    """Height of a wavy face at the outer radius, of the place across the block, 0 to 1 [mm]."""
    phase = 2 * block.frequency * across + block.shift / 2
    return block.amplitude * np.sin(2 * np.pi * phase)


@ERRATA.add
def _density_unit(evidence: PaperEvidence) -> ClaimVerdict:
    fem = reference()["fem"]
    run = evidence.case("TSB1", "pipe")
    volume = float(run.details.blocks.volumes[run.details.blocks.free_blocks[0]])
    kilograms = {"kg/mm³": fem["density"] * volume, "t/mm³": 1e3 * fem["density"] * volume}
    speed = {
        "kg/mm³": np.sqrt(fem["young_modulus"] / (1e-3 * fem["density"])) / 1e6,
        "t/mm³": np.sqrt(fem["young_modulus"] / fem["density"]) / 1e6,
    }
    return shown(
        f"a block of {volume / 1e6:.2f} dm³ would weigh {kilograms['kg/mm³']:.4f} kg as printed, "
        f"{kilograms['t/mm³']:.1f} kg with t/mm³; waves would run at {speed['kg/mm³']:.0f} km/s as "
        f"printed, {speed['t/mm³']:.1f} km/s with t/mm³ (concrete: 3 to 4)",
        {"block_mass_kg": kilograms, "wave_speed_km_s": {k: float(v) for k, v in speed.items()}},
    )


@ERRATA.add
def _friction(evidence: PaperEvidence) -> ClaimVerdict:
    run = evidence.case("TSB1", "pipe")
    coefficient = reference()["fem"]["friction_coefficient"]
    block = int(run.details.blocks.free_blocks[len(run.details.blocks.free_blocks) // 2])
    interfaces, index = run.details.blocks.interfaces, run.details.contact_index
    touches = (interfaces.block_m[index] == block) | (interfaces.block_s[index] == block)
    normal = float(run.details.contact_forces[touches].sum())
    load = float(
        np.linalg.norm(run.details.load.facet_forces[run.details.load.block == block].sum(axis=0))
    )
    share = coefficient * normal / load
    return shown(
        f"one block of TSB1, pipe: contact forces {normal:.0f} N for a load of {load:.0f} N; "
        f"friction of {coefficient:g} can carry at most {100 * share:.1f} % of the load: small, "
        "not zero",
        {"coefficient": coefficient, "contact_force": normal, "load": load, "share": share},
    )


@ERRATA.add
def _half_block(_: PaperEvidence) -> ClaimVerdict:
    block = block_of_tube(load_case("tsb1-pipe"))
    half = block.inner_radius * np.sqrt(2 * (1 - np.cos(np.pi / block.blocks_per_layer)))
    whole = 2 * block.inner_radius * np.sin(np.pi / block.blocks_per_layer)
    across = np.linspace(0.0, 1.0, 3001)
    z = _wave(block, across)
    valleys = int(((z[1:-1] < z[:-2]) & (z[1:-1] < z[2:])).sum())
    try:
        refusal = repr(load_case("tsb1-pipe", ["block.frequency=0.75"]).problem)
    except RefusedError as error:
        refusal = str(error).split(";")[0]
    return shown(
        f"printed ℓ = {half:.1f} mm, a block's chord is {whole:.1f} mm; f = 1.5 on ℓ gives the "
        f"{valleys} valleys per block that the paper counts; f = 1.5 on the whole block would be "
        f"f = 0.75 on ℓ: {refusal}",
        {"half_chord": float(half), "chord": float(whole), "valleys": valleys, "refusal": refusal},
    )


@ERRATA.add
def _layer_shift(_: PaperEvidence) -> ClaimVerdict:
    block = block_of_tube(load_case("tsb1-pipe"))
    across = np.linspace(0.0, 1.0, 3001)

    def misfit(turn: float) -> float:
        return float(np.abs(_wave(block, across) - _wave(block, across + turn)).max())

    third = int(block.frequency) / block.waves_per_block
    return shown(
        f"TSB1: turned by half a block the faces miss each other by up to {misfit(0.5):.1f} mm; "
        f"turned by {third:.3f} of a block (one wave) by {misfit(third):.1e} mm",
        {"half_block": misfit(0.5), "whole_waves": misfit(third), "turn": third},
    )


@ERRATA.add
def _one_wave(evidence: PaperEvidence) -> ClaimVerdict:
    """Three designs of the study with either turn: what the paper says holds for one of them."""
    by_frequency = {f: p_max(evidence.tsb((0.0, f, 6, 30.0, 25.0))) for f in (1.0, 1.5, 2.0)}
    other = replace(evidence, turn="half block")
    half = p_max(other.tsb((0.0, 2.0, 6, 30.0, 25.0)))
    return shown(
        "n = 6, a = 25, t = 30: turned by one wave p_max is "
        + ", ".join(f"{p:.3f} (f = {f:g})" for f, p in by_frequency.items())
        + f" MPa, it rises with f as the paper says; turned by half a block it is {half:.3f} at "
        "f = 2. At f = 1 and 1.5, and so in the tables, both turns are the same",
        {"one_wave": {f"{f:g}": p for f, p in by_frequency.items()}, "half_block": half},
    )


@ERRATA.add
def _pillar_frames(evidence: PaperEvidence) -> ClaimVerdict:
    words, values = [], {}
    for block in ("TSB1", "TSB2", "THB0"):
        tube = evidence.case(block, "pillar").details
        held, free = str(tube.mechanism), str(tube.supported_classification.mechanism)
        words.append(f"{block}: {held} with both frames held, {free} with the top frame free")
        values[block] = {"held": held, "released": free}
    return shown("; ".join(words), values)


@ERRATA.add
def _rotation_variation(_: PaperEvidence) -> ClaimVerdict:
    rng = np.random.default_rng(0)
    axis = rng.standard_normal(3)
    skew = np.cross(np.eye(3), axis / np.linalg.norm(axis))
    rotation = np.eye(3) + np.sin(1.0) * skew + (1 - np.cos(1.0)) * skew @ skew
    turn, arm = rng.standard_normal(3), rng.standard_normal(3)
    body = rotation @ np.cross(turn, arm)
    printed = np.cross(turn, rotation @ arm)
    spatial = np.cross(rotation @ turn, rotation @ arm)
    size = float(np.linalg.norm(body))
    wrong = float(np.linalg.norm(body - printed)) / size
    right = float(np.linalg.norm(body - spatial)) / size
    return shown(
        f"a turn of 1 rad, random vectors: R [δθ]ₓ s differs from δθ × R s by {100 * wrong:.0f} %, "
        f"from (R δθ) × R s by {right:.0e}; at R = I, where everything is evaluated, both agree",
        {"printed": wrong, "spatial": right},
    )


@ERRATA.add
def _captions(_: PaperEvidence) -> ClaimVerdict:
    principal = np.linalg.eigvalsh(np.diag([2.0, -1.0, 0.5]))[::-1]
    return shown(
        f"σ₁, σ₂, σ₃ of diag(2, -1, 0.5) = {', '.join(f'{v:g}' for v in principal)}: the smallest "
        "is σ₃; ten planes are announced, four heights are printed",
        {"principal": principal.tolist()},
    )


def show_errata(evidence: PaperEvidence, names: list[str] | None = None) -> list[dict[str, Any]]:
    """Demonstrate all errata, or some by name (`chosen_by_name`), with the command that does it."""
    rows = []
    for erratum in chosen_by_name(ERRATA, names, "erratum"):
        verdict = erratum.judge(evidence)
        by = {"shown": verdict.number, "values": verdict.values}
        command = f"tubelock reproduce errata {erratum.name}"
        rows.append({"name": erratum.name, **erratum.text, **by, "command": command})
    return rows
