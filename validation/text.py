"""Results as text for people (rich tables)."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from mbd import Mechanism, MechanismClass, RigidResult, SelfStress
from validation.further import add_further_rows
from validation.rigid import RigidRun

_CLASSES = {
    MechanismClass.LOCKED: "locked: no block can move",
    MechanismClass.SUPPRESSED: "suppressed: blocks could move, the load holds them",
    MechanismClass.NEUTRAL: "neutral: blocks could move, the load neither drives nor holds them",
    MechanismClass.ACTIVATED: "activated: blocks can move, and the load drives them",
    MechanismClass.UNDECIDED: "undecided: no proof of either was found within tolerance",
}


def certificate_words(result: RigidResult) -> str:
    """Say what proves the mechanism class, with the numbers of the proof."""
    certificate = result.classification.certificate
    if isinstance(certificate, SelfStress):
        return (
            f"self-stress λ ≥ 1, ‖Gλ‖/‖λ‖ = {certificate.residual:.1e}, "
            f"σ_min/σ_max = {certificate.smallest_singular_value:.1e}"
        )
    if isinstance(certificate, Mechanism):
        return (
            f"mechanism δq, min Gᵀδq = {certificate.smallest_gap_rate:.1e}, "
            f"fᵀδq/‖f‖ = {certificate.work:.3g}"
        )
    return "none"


def print_rigid(run: RigidRun, console: Console) -> None:
    """Print class, residual, measures and times of a rigid result."""
    result, scene = run.result, run.scene
    table = Table(title=f"{run.name}: rigid blocks", show_header=False, title_justify="left")
    table.add_column(justify="left")
    table.add_column(justify="left")
    table.add_row("mechanism (frame fixed)", _CLASSES[result.mechanism])
    if result.supported_classification is not result.classification:
        supported = _CLASSES[result.supported_classification.mechanism]
        table.add_row("mechanism (as supported)", supported)
    table.add_row("certificate", certificate_words(result))
    table.add_row("equilibrium", result.equilibrium.status)
    if result.measures is not None:
        m = result.measures
        table.add_row("effective contact elements", f"{m.effective_count_percent:.2f} %")
        table.add_row("effective contact area", f"{m.effective_area_percent:.2f} %")
        table.add_row("p_eff", f"{m.p_eff:.5g} MPa mean of the effective elements")
        table.add_row("p_max", f"{m.p_max:.5g} MPa mean of block maxima")
    add_further_rows(table, run.further)
    table.add_row("blocks, contacts", f"{result.n_blocks} free, {result.n_contacts}")
    table.add_row(
        "norm, solver",
        f"{scene.rigid.norm}, {scene.rigid.solver} ({result.equilibrium.iterations} iterations)",
    )
    seconds = ", ".join(f"{stage} {value:.3f}" for stage, value in run.cpu_seconds.items())
    table.add_row("CPU seconds", seconds)
    console.print(table)
