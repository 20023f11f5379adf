"""Every answer: `solve(case)`, by rigid blocks, statics or explicit dynamics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from geometry.parts.rows import Notes, Row
from mbd.options import Rigid
from validation.case import Case
from validation.errors import InputError, named
from validation.scene.family import RoundScene
from validation.scene.polyhedra import STRAIGHT_EDGES, PolyhedralScene

if TYPE_CHECKING:
    from fem.explicit.solve import Frame
    from geometry.answer import Answer
    from geometry.machine.work import Budget
    from geometry.parts.rows import Part
    from mbd.analysis import RigidStatement

#: Load cases that put the ring of a tube under pressure: the loaded face, and what the ring gets.
_RINGS = {"pipe": ("inner", "tension"), "tunnel": ("outer", "compression")}
_OPPOSITE = {"tension": "compression", "compression": "tension"}


def solve(
    case: Case,
    progress: Callable[[Any], None] | None = None,
    *,
    otherwise: Mapping[str, float] | None = None,
    on_frame: Callable[[Frame], None] | None = None,
    checkpoint: Path | None = None,
    resume: Path | None = None,
) -> Answer:
    """Answer a case by its method.

    Parameters
    ----------
    case
        Of `load_case`, or ``Case(name=..., stated=problem, method=Rigid())``.
    progress
        Called with what the run is at: words, or an object whose ``str`` is.
    otherwise
        Relative error bars [-] that a static state is refined to where its method has no accuracy;
        None: `fem.accuracy.converge.TARGETS`.
    on_frame, checkpoint, resume
        As `fem.solve_static` and `fem.solve_explicit`.

    Returns
    -------
    Answer
        With its case; ``print(answer)`` is its table.

    Raises
    ------
    InputError
        One line: what was got, what is expected, what to do.
    KeyboardInterrupt
        An explicit run that was interrupted and has no checkpoint.
    """
    show = progress or (lambda _: None)
    if isinstance(case.method, Rigid):
        answer = solve_rigid(case, show)
    else:
        from validation.run.deformable import Follower, deformable_answer

        follower = Follower(progress=show, on_frame=on_frame, checkpoint=checkpoint, resume=resume)
        answer = deformable_answer(case, follower, otherwise=otherwise)
        run = answer.details.run
        if checkpoint is None and run is not None and run.status == "interrupted":
            raise KeyboardInterrupt(
                f"{run.n_steps} time steps were done; no checkpoint was written: -o names a folder "
                "for one"
            )
    return replace(answer, case=case)


def repeatable(answer: Answer) -> Answer:
    """Return an answer that every machine gives.

    Raises
    ------
    KeyboardInterrupt
        Ctrl-C ended its run.
    InputError
        A limit of CPU time did.
    """
    run = None if answer.method == "rigid" else answer.details.run
    by = cast("Budget", answer.parts["work"]).stopped_by
    if by == "interrupt" or (run is not None and run.status == "interrupted"):
        raise KeyboardInterrupt
    if run is not None and by == "work":
        raise InputError(
            "fem.max_work: the limit of work ended an explicit run before its end; expected more, "
            "or none"
        )
    if by == "clock":
        section = "rigid" if answer.method == "rigid" else "fem"
        raise InputError(
            f"{section}.max_seconds: the limit of CPU time ended a run, and its answer depends on "
            f"the machine; expected {section}.max_work, which is the same on every machine"
        )
    return answer


# ---------------------------------------------------------------------------------------------
# Rigid blocks


def solve_rigid(
    case: Case, tell: Callable[[str], None], stated: RigidStatement | None = None
) -> Answer:
    """Answer a case by rigid blocks, which may be built already: ``stated``."""
    from geometry.compilation.clocks import stages, summed
    from mbd.answer import analyse

    assert isinstance(case.method, Rigid)
    with stages() as watch:
        if stated is None:
            tell("reads the blocks and finds where they touch")
            stated = case.problem
        watch.lap("build")
    built = watch.seconds()
    with named(case.name):
        answer = analyse(stated, case.method, progress=tell)
        parts = _rigid_parts(case, answer) if case.is_scene else {}
    seconds = summed({"build": 0.0} | answer.details.cpu_seconds, built)
    told: dict[str, Any] = {"scene": case.name, "cpu_seconds": seconds}
    if case.is_scene:
        told["load"] = case.scene.load_words
    return replace(answer.beside(parts, told), case=case)


def _rigid_parts(case: Case, answer: Answer) -> dict[str, Part]:
    """What a scene adds to the answer of its rigid blocks."""
    from validation.build.problem import scene_planes

    scene, blocks = case.scene, answer.details.blocks
    parts: dict[str, Part] = {}
    hoop = hoop_stress(scene)
    if hoop is not None:
        parts["ring_pressure"] = hoop
    cut = scene_planes(scene, blocks)
    if cut is not None:
        carried = answer.details.holds and answer.cut is not None
        none = Notes([Row("sections", "none: the load is not carried")])
        parts["sections"] = answer.cut(cut) if carried and answer.cut is not None else none
    if isinstance(scene, PolyhedralScene):
        from validation.build.readings import doubts

        straight = any(shape.straightened for shape in blocks.shapes)
        notes = {"edges": STRAIGHT_EDGES} if straight else {}
        notes |= doubts(scene, blocks, case.folder, blocks)
        parts["notes"] = Notes([Row(*note) for note in notes.items()])
    return parts


@dataclass(frozen=True)
class HoopStress:
    """Mean hoop stress p·r/t of a closed ring, by hand."""

    value: float
    """[MPa]"""
    radius: float
    """Of the loaded face [mm]."""
    sense: str
    """Tension or compression."""
    unit: str = "MPa"

    @property
    def rows(self) -> list[Row]:
        """The stress, with a remark on dry joints."""
        words = f"{self.value:.5g} MPa, mean hoop {self.sense} of a closed ring, "
        words += f"r = {self.radius:g} mm"
        if self.sense == "tension":
            words += "; dry joints carry no tension: waves and end rings do"
        return [Row("hoop stress p·r/t", words, self.value, self.unit)]

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)


def hoop_stress(scene: object) -> HoopStress | None:
    """Hoop stress of a tube under pressure; None of all else."""
    if not isinstance(scene, RoundScene) or scene.load.case not in _RINGS:
        return None
    face, sense = _RINGS[scene.load.case]
    pressure, thickness = scene.load.pressure, scene.thickness
    radius = float(scene.block.inner_radius)
    radius += thickness * (face == "outer")
    sense = sense if pressure >= 0.0 else _OPPOSITE[sense]
    return HoopStress(abs(pressure) * radius / thickness, radius, sense)
