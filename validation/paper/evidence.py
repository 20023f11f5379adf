"""What the paper's figures and claims are judged by: computed when first asked for, then kept.

The parameter study lives in a result file, so it is computed once and goes on where it was
stopped. Deformable runs cost minutes; without them the claims that need them are not computed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise, product
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from geometry import Answer, SineBlock
from validation import Case, InputError, load_case, solve, sweep
from validation.paper.reading import MESH_OF_TABLES, SharedTubes, solve_row

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]
Tell: TypeAlias = Callable[..., object]
"""Called with what is computed, in words; also with how much of how much is done."""

#: shift, frequency, blocks per layer, thickness [mm], amplitude [mm].
Design = tuple[float, float, int, float, float]
STUDY = "paper-480"
#: Its designs with f = 2, every second layer turned by half a block instead of one wave.
HALF_BLOCK_STUDY = "half-block-160"
PATHS = (
    "block.shift",
    "block.frequency",
    "block.blocks_per_layer",
    "block.thickness",
    "block.amplitude",
)
#: Load cases in which the paper's convention and the full load agree.
_ONE_READING = ("pipe", "tunnel", "pillar", "beam")


@dataclass(frozen=True)
class StudyTable:
    """The parameter study by design."""

    rows: dict[Design, dict[str, Any]]
    """All columns of the result file."""
    axes: tuple[tuple[float, ...], ...]
    """Values of shift, frequency, blocks per layer, thickness and amplitude."""
    mesh: str
    """Elements of one block, in words."""

    @cached_property
    def p_max(self) -> dict[Design, float]:
        """Max–mean contact pressure of each design [MPa]."""
        return {key: float(row["p_max"]) for key, row in self.rows.items()}

    @property
    def cpu_seconds(self) -> float:
        """CPU time of all designs [s]."""
        return float(sum(row["cpu_seconds"] for row in self.rows.values()))

    def pairs(self, axis: int) -> list[tuple[Design, Design]]:
        """All pairs of designs that differ by one step of one parameter, by its place in them."""
        following = dict(pairwise(self.axes[axis]))
        return [
            (_design(key), _design((*key[:axis], following[key[axis]], *key[axis + 1 :])))
            for key in product(*self.axes)
            if key[axis] in following
        ]


def _design(key: Iterable[float]) -> Design:
    shift, frequency, n, thickness, amplitude = key
    return (shift, frequency, int(n), thickness, amplitude)


def read_table(study: Any, path: Path) -> StudyTable:
    """Take a finished parameter study, a `validation.sweep`, whose rows are in a file."""
    rows = {_design(row[path] for path in PATHS): row for row in study.rows}
    failed = next((row for row in study.rows if row["status"] != "ok"), None)
    if failed is not None:
        raise InputError(
            f"{path}: design {failed['number']} failed: {failed['message']}; "
            "remove the file or use `tubelock sweep --retry-failed`"
        )
    values = dict(study.study.parameters)
    mesh = study.study.case(0).keys["mesh"]
    words = f"{mesh['around']} × {mesh['radial']} × {mesh['axial']}"
    return StudyTable(rows, tuple(tuple(values[path]) for path in PATHS), words)


def nobody(*_: object) -> None:
    """Print no progress."""


@dataclass
class PaperEvidence:
    """Everything computed for the paper, once."""

    folder: Path
    """Where the parameter study's result file lies."""
    tell: Tell = nobody
    """Progress."""
    deformable: bool = False
    """Whether deformable runs may be computed."""
    full: bool = False
    """The resolution of the tables, 84 × 24 × 20, in the parameter study as well; finer FEM."""
    workers: int | None = None
    """Processes of the parameter study; None: one per core."""
    cpu_seconds: dict[str, float] = field(default_factory=dict)
    """CPU time of what was computed, by its name [s]."""
    turn: Literal["one wave", "half block"] = "one wave"
    """Turn of every second layer in the parameter study; the paper's, or another reading."""
    _tubes: SharedTubes = field(default_factory=SharedTubes)
    rigid_runs: dict[tuple[str, tuple[str, ...]], Answer] = field(default_factory=dict)
    """Those computed so far, by scene and settings."""
    fem_runs: dict[tuple[str, str], Answer] = field(default_factory=dict)
    """Those computed so far, by block and load case."""

    @cached_property
    def study(self) -> StudyTable:
        """The 480 designs."""
        return self._swept(STUDY, "parameter study")

    @cached_property
    def half_block(self) -> StudyTable:
        """The 480 designs with the half-block turn: those of f = 2 are other ones."""
        other = self._swept(HALF_BLOCK_STUDY, "half-block study")
        return replace(self.study, rows=self.study.rows | other.rows)

    def with_half_block(self) -> PaperEvidence:
        """Return the same evidence, the parameter study with the half-block turn."""
        other = replace(self, turn="half block")
        other.__dict__["study"] = self.half_block
        return other

    def _swept(self, built_in: str, words: str) -> StudyTable:
        """Rows of a built-in study, computed where the result file lacks them."""
        name = f"{built_in}{'-full' if self.full else ''}.jsonl"
        table = read_table(
            sweep(
                built_in,
                settings=["mesh.radial=24"] if self.full else [],
                store=self.folder / name,
                workers=self.workers,
                progress=lambda state, *share: self.tell(f"{words}: {state}", *share),
            ),
            self.folder / name,
        )
        self.cpu_seconds[words] = table.cpu_seconds
        return table

    def rigid(self, scene: str, *settings: str) -> Answer:
        """Rigid-block result of a built-in scene with overrides, computed once."""
        if scene.rpartition("-")[2] in _ONE_READING:
            settings = tuple(s for s in settings if not s.startswith("load.as_printed"))
        key = (scene, settings)
        if key not in self.rigid_runs:
            start = time.process_time()
            self.rigid_runs[key] = self._tubes.solve(scene, *settings)
            spent = time.process_time() - start
            self.cpu_seconds["rigid"] = self.cpu_seconds.get("rigid", 0.0) + spent
        return self.rigid_runs[key]

    def case(self, block: str, case: str) -> Answer:
        """A row of the paper's tables, on their mesh and read as they are."""
        return solve_row(self.rigid, block, case)

    def tsb(self, design: Design) -> Answer:
        """Rigid-block result of a design of the study at the resolution of the tables."""
        values = [f"{path}={value}" for path, value in zip(PATHS, design, strict=True)]
        turn = f'assembly.turn="{self.turn}"'
        return self.rigid("tsb1-pipe", *MESH_OF_TABLES["TSB"], turn, *values)

    def fem(self, block: str, case: str) -> Answer:
        """Deformable result of a load case, computed once; asked for where `deformable` allows."""
        key = (block, case)
        if key not in self.fem_runs:
            self.fem_runs[key] = self._run_fem(block, case)
        return self.fem_runs[key]

    def fem_mesh(self, case: str, /) -> tuple[int, int, int]:
        """Elements of one deformable block: around, radial, axial."""
        # A beam has no symmetry to use: it stays at the coarser mesh.
        return (48, 8, 20) if self.full and case != "beam" else (24, 4, 10)

    def whole_tube(self, block: str, case: str, layers: int) -> Answer:
        """Deformable result of a shorter tube, solved without using its symmetry."""
        settings = [f"assembly.layers={layers}", "fem.symmetry=none"]
        return self._run_fem(block, case, settings, f"{layers} layers, no symmetry")

    def _run_fem(
        self, block: str, case: str, settings: Iterable[str] = (), words: str = ""
    ) -> Answer:
        """Static state on a mesh of its own; one sector where the load is cyclic."""
        around, radial, axial = self.fem_mesh(case)
        symmetry = "none" if case == "beam" else "sector"
        name = f"{block.lower()}-{case}"
        mesh = (f"mesh.around={around}", f"mesh.radial={radial}", f"mesh.axial={axial}")
        own = ("fem.method=static", "fem.mesh=scene", "fem.error_estimate=false")
        self.tell(f"deformable blocks: {name} {words}")
        answer = solve(load_case(name, [*own, f"fem.symmetry={symmetry}", *mesh, *settings]))
        label = f"fem {name} {around} × {radial} × {axial} {words}".strip()
        self.cpu_seconds[label] = answer.report["cpu_seconds"]["total"]
        return answer


def block_of_tube(case: Case) -> SineBlock:
    """Return the block that the scene of a tube states."""
    return SineBlock(**{key: value for key, value in case.keys["block"].items() if key != "type"})


def paper_measures_of(run: Answer) -> Any:
    """Return the paper's measures of a tube that its contacts hold in equilibrium."""
    measures = run.details.measures
    assert measures is not None
    return measures


def p_max(run: Answer) -> float:
    """Max–mean contact pressure of such a tube [MPa]."""
    return float(paper_measures_of(run).p_max)
