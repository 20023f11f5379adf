"""A case and its answer: a problem, stated by a scene or in Python, a method, and `solve`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, cast

from fem.method import Explicit, Static
from geometry.machine.work import timed_stages
from mbd.options import Rigid
from validation.errors import InputError, named
from validation.scene.combinations import combined
from validation.scene.deformable import EFFECTS_IN_TIME, METHODS
from validation.scene.family import RoundScene
from validation.scene.keys.idle import KeyUse
from validation.scene.keys.quantities import Number, numbers_in, unit_of_key
from validation.scene.keys.toml_text import flat
from validation.scene.read import (
    DeformableScene,
    Settings,
    apply_overrides,
    check_scene,
    require_plausible,
    scene_data,
)
from validation.scene.sections import LimitsSection, PicturesSection

if TYPE_CHECKING:
    from fem.explicit.solve import Frame
    from fem.problem import Problem
    from geometry.answer import Answer
    from geometry.assembly import Assembly
    from geometry.machine.work import Budget
    from geometry.parts.dimensions import Built
    from validation.build.polyhedra import FileBlocks
    from validation.scene.families.mesh import MeshScene

#: How blocks are answered.
Method: TypeAlias = Rigid | Static | Explicit


@dataclass(frozen=True)
class Case:
    """A problem and a method: what `validation.solve` answers.

    ``Case(problem, Rigid())`` is one of a problem made in Python; `load_case` reads that of a
    scene, whose problem is compiled when it is first asked for.
    """

    stated: Problem | None
    """The problem, where it is made already; None: it is compiled from the scene."""
    method: Method
    """How it is answered; of a scene its ``[fem]``, unless `with_method` says another."""
    name: str = "problem"
    """Name of the built-in scene or stem of the file."""
    source: DeformableScene | None = None
    """Checked scene that it is compiled from; None: its problem was made in Python."""
    file: Path | None = None
    """File that the scene was read from; None: it is built in, or a problem."""

    def __repr__(self) -> str:
        """Name and method."""
        return f"<case {self.name}: {self.method}>"

    @property
    def scene(self) -> DeformableScene:
        """The scene, whose keys `changed` and studies vary.

        Raises
        ------
        InputError
            A case of a problem, which has no keys.
        """
        if self.source is None:
            raise InputError(
                f"{self.name}: got a problem, which has no keys of a scene; expected a case of "
                "load_case, or dataclasses.replace(problem, ...)"
            )
        return self.source

    @cached_property
    def problem(self) -> Problem:
        """Blocks, load, material and what acts between blocks, as its method takes them.

        Solids have hexahedra where they deform.

        Raises
        ------
        InputError
            A scene that cannot be built.
        """
        return self._compiled(None) if self.stated is None else self.stated

    def _compiled(self, known: Assembly | None) -> Problem:
        """The problem of its scene; ``known`` are blocks that are built already."""
        from validation.build.problem import rigid_problem, scene_problem

        if isinstance(self.method, Rigid):
            return rigid_problem(self.scene, self.name, known)
        return scene_problem(self.scene, self.name)

    def on(self, blocks: Assembly) -> Case:
        """Return the case of rigid blocks on those of another case with the same keys of blocks."""
        return replace(self, stated=self._compiled(blocks))

    def told(self, answer: Answer, built: dict[str, float]) -> Answer:
        """Return an answer to it with what only its scene knows: title, load, sections, notes.

        ``built`` are the times of what was done before it was solved [s].
        """
        if self.source is None:
            return answer
        from validation.build.problem import told

        return told(self.source, self.name, answer, built)

    def check(self) -> Problem:
        """Return the problem, of which everything is rejected here that its method cannot answer.

        Raises
        ------
        InputError
            One line: what was got, what is expected, what to do.
        """
        problem, method = self.problem, self.method
        with named(self.name, keys=self.source is not None):
            if isinstance(method, Rigid):
                from mbd.answer import check

                check(problem, method)
            elif isinstance(method, Static):
                from fem.accuracy.statics import check_static

                problem = check_static(problem, method)
                if problem.coulomb is not None or problem.blocks.detection is not None:
                    from mbd.held import require_held  # it proves nothing of other problems

                    require_held(problem)
            else:
                from fem.dynamics import check_explicit, check_step

                problem = check_explicit(problem, method)
                check_step(problem, method)
        return problem

    @property
    def limits(self) -> LimitsSection:
        """What can be built."""
        return LimitsSection() if self.source is None else self.source.limits

    @property
    def load_words(self) -> str:
        """The load with its size."""
        return self.problem.load_case.name if self.source is None else self.source.load_words

    @property
    def pictures(self) -> PicturesSection:
        """What its pictures show."""
        return PicturesSection() if self.source is None else self.source.pictures

    @property
    def auto(self) -> float | None:
        """Share of p_max, p_eff and u within which effects are left out [-]; None: none are."""
        return None if self.source is None else self.source.effects.auto

    @property
    def in_time(self) -> Explicit:
        """How it is solved in time: of a static one the effects of explicit runs that it states."""
        return self.scene.in_time

    @property
    def file_blocks(self) -> FileBlocks | None:
        """Blocks of its files, those that cannot be analysed too; None: it has no files."""
        if not self.scene.files:
            return None
        from validation.build.polyhedra import file_blocks

        return file_blocks(cast("MeshScene", self.scene))

    @property
    def meets(self) -> bool:
        """Whether its blocks meet; else they are single bodies."""
        return self.scene.meets

    @property
    def kind(self) -> str:
        """Type of its blocks."""
        return str(self.scene.block.type)

    @property
    def is_tube(self) -> bool:
        """Whether its keys make blocks that stand round an axis, in layers."""
        return isinstance(self.source, RoundScene)

    @property
    def element_counts(self) -> dict[str, Any]:
        """Values of ``[mesh]`` that count elements; none where every block has its own mesh."""
        return self.scene.element_counts

    @property
    def values(self) -> dict[str, Any]:
        """Values of all keys of its scene by ``section.key``, defaults included."""
        return dict(flat(self.scene.model_dump(mode="json")))

    def unit(self, key: str) -> str:
        """Unit of a key of its scene; empty where it has none."""
        unit = unit_of_key(self.scene, key)
        return "" if unit is None else unit.name

    def numbers(self, *sections: str) -> list[Number]:
        """Numbers that its scene has in some sections, parts of lists and vectors among them."""
        return [n for name in sections for n in numbers_in(getattr(self.scene, name, None), name)]

    @property
    def frames_may_lock(self) -> bool:
        """Whether frames at both ends may lock a short assembly whose blocks alone are not."""
        return self.scene.frames_may_lock

    @property
    def combinations(self) -> tuple[str, ...]:
        """Names of its combinations of loads."""
        return () if self.source is None else tuple(self.source.combinations)

    @property
    def keys(self) -> dict[str, Any]:
        """What its scene states, as plain data by section."""
        return self.scene.model_dump(mode="json", exclude_unset=True)

    def key_use(self, method: str = "", *, drawn: bool = True) -> KeyUse:
        """Which keys of its scene an answer depends on: by its method, a deck or the blocks alone.

        ``drawn``: whether pictures are requested.
        """
        return KeyUse(self.scene, method or self.method.name, drawn)

    @property
    def reads(self) -> tuple[Path, ...]:
        """Files that say what the case is: its own, and those of its blocks."""
        parts = () if self.source is None else self.source.files
        return (*(() if self.file is None else (self.file,)), *(Path(p.file) for p in parts))

    def changed(self, settings: Settings) -> Case:
        """Return the case with other values, by the keys of its scene; None leaves a key out.

        Raises
        ------
        InputError
            A key or a value that the scene does not have.
        """
        return self.stating(check_scene(apply_overrides(self.keys, settings), self.name))

    def combined(self, name: str) -> Case:
        """Return the case with the loads of one of its combinations."""
        return replace(self.stating(combined(self.scene, name)), name=f"{self.name}, {name}")

    def coarser(self, share: float) -> Case | None:
        """Return the case with about that share of the elements along every edge.

        None where it has no fewer: meshes that are given node by node have no coarser one.
        """
        scene = self.scene.coarser(share)
        return None if scene is None else self.stating(scene)

    def stating(self, scene: DeformableScene) -> Case:
        """Return the case with another scene, checked as one of a file, and its kind of method."""
        require_plausible(scene, self.name)
        method = scene.rigid_method if isinstance(self.method, Rigid) else scene.method
        return replace(self, source=scene, method=method, stated=None)

    def with_method(self, method: Method | str) -> Case:
        """Return the case with another method, or with "rigid", "static" or "explicit" as stated.

        Raises
        ------
        InputError
            A method of another name, or one that the blocks cannot have.
        """
        if self.source is None:
            return replace(self, method=_named(self.name, method))
        if method == "rigid":
            return replace(self, method=self.source.rigid_method)
        if isinstance(method, str):
            _named(self.name, method)
            return replace(self, method=Static()).changed({"fem.method": method})
        return replace(self, method=method).changed(_keys_of(method))


def _keys_of(method: Method) -> dict[str, Any]:
    """Keys of a scene that state a method, and None for those of the effects of another one."""
    values = {part.name: getattr(method, part.name) for part in fields(method)}
    given = {key: vars(one) if is_dataclass(one) else one for key, one in values.items()}
    if isinstance(method, Rigid):
        stages = given.pop("stages")
        return {"stages": stages, **{f"rigid.{key}": value for key, value in given.items()}}
    effects = {f"effects.{key}": given.pop(key, None) for key in EFFECTS_IN_TIME}
    return {"fem.method": method.name, **{f"fem.{k}": v for k, v in given.items()}, **effects}


def _named(name: str, method: Method | str) -> Method:
    """Method of a name; what is a method already stays."""
    if not isinstance(method, str):
        return method
    kinds = {"rigid": Rigid, **METHODS}
    if method not in kinds:
        raise InputError(f"{name}: method: got {method!r}; expected one of {', '.join(kinds)}")
    return kinds[method]()


def load_case(
    source: str | Path | Mapping[str, Any],
    settings: Settings = (),
    *,
    method: Method | str | None = None,
) -> Case:
    """Read and check a scene.

    Parameters
    ----------
    source
        Name of a built-in scene, a TOML file, or the data of one: ``{"block": {...}, ...}``.
    settings
        Values that replace or add to those of the scene, such as ``{"assembly.layers": 2}``.
    method
        "rigid", "static", "explicit", or a method itself; None: as ``[fem]`` says.

    Raises
    ------
    InputError
        One line: what was got, what is expected, what to do.
    """
    if isinstance(source, Mapping):
        name, text, path, data = "scene", "scene", Path(), dict(source)
    else:
        text, path = str(source), Path(source)
        name, data = scene_data(text)
    if isinstance(method, str) and method in METHODS:  # whose keys the settings may state
        data = apply_overrides(data, {"fem.method": method})
    # What is typed or redirected names files as the shell does.
    folder = Path() if path == Path("/dev/stdin") else path.parent
    scene = check_scene(apply_overrides(data, settings), text).located(folder)
    own = path if path.is_file() else None
    case = Case(None, scene.method, name, scene, own)
    return case if method is None else case.with_method(method)


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
        Of `load_case`, or ``Case(problem, Rigid())``.
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
    show, method = progress or (lambda _: None), case.method
    show("builds the blocks and finds where they touch")
    with timed_stages() as watch:
        problem = case.check() if isinstance(method, Static) else case.problem
        watch.lap("build")
    built = watch.seconds()
    with named(case.name, keys=case.source is not None):
        if isinstance(method, Rigid):
            from mbd.answer import analyse

            answer = analyse(problem, method, progress=show)
        elif isinstance(method, Static):
            from fem.accuracy.statics import solve_static

            with _explained(problem):
                answer = solve_static(
                    problem, method, otherwise=otherwise, progress=show, on_frame=on_frame
                )
        else:
            from fem.dynamics import solve_explicit

            answer = solve_explicit(
                problem,
                method,
                progress=show,
                on_frame=on_frame,
                checkpoint=checkpoint,
                resume=resume,
            )
            run = answer.details.run
            if checkpoint is None and run.status == "interrupted":
                raise KeyboardInterrupt(
                    f"{run.n_steps} time steps were done; no checkpoint was written: -o names a "
                    "folder for one"
                )
    from geometry.parts.dimensions import Limits

    answer = case.told(answer, built)
    built_blocks = cast("Built", answer.parts["dimensions"])
    limits = Limits(case.limits.least_wall, case.limits.steepest_joint)
    return replace(answer.beside({"dimensions": replace(built_blocks, limits=limits)}), case=case)


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


def require_deformable(case: Case, command: str) -> None:
    """Reject a case without deformable blocks in contact."""
    if not case.meets:
        raise InputError(
            f"{case.name}: block.type {case.kind!r} has no deformable blocks in "
            f"contact, and `tubelock {command}` needs them; expected a scene such as tsb1-pipe"
        )


def refuse_cell(case: Case, command: str) -> None:
    """Reject a periodic cell where the whole tube is needed."""
    if case.scene.is_cell:
        raise InputError(
            f'{case.name}: fem.symmetry: got "periodic cell"; `tubelock {command}` needs the whole '
            'tube: expected "auto"'
        )


@contextmanager
def _explained(problem: Problem) -> Iterator[None]:
    """Say what lets blocks move where no equilibrium is found, as rigid blocks tell.

    A limit of work or time says nothing of the blocks.
    """
    from fem.static.linear_step.linearisation import SparseSolverError, StaticError

    try:
        yield
    except (StaticError, SparseSolverError) as error:
        if error.of_input:
            from mbd.held import explain_unheld

            explain_unheld(problem, error)
        raise
