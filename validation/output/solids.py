"""What is wrong with the blocks of a file, and the same blocks written again."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from geometry.files.block_files import STEP_SUFFIXES, UNITS, diagnosed_blocks
from geometry.files.named_surfaces import Y_UP
from geometry.files.readers import OWN_UNITS, left_out
from geometry.files.write_solids import SOLID_SUFFIXES, write_solids
from geometry.mesh import FloatArray, MeshError
from geometry.parts.rows import Row, RowTable
from geometry.polyhedra.assembly import PolyhedralAssembly
from geometry.polyhedra.near_joints import distance_between
from geometry.polyhedra.overlap import Overlap, find_overlaps
from geometry.polyhedra.polyhedron import Polyhedron
from validation.build.polyhedra import FileBlocks, PlacedSolids
from validation.build.readings import facing_words
from validation.case import Case
from validation.errors import InputError
from validation.output.files import prepare_file

#: Faces farther apart than this many contact tolerances are no gap of a joint.
_GAPS = 100.0
#: Rows of a kind that the table shows; JSON has all.
_MOST = 20
#: Blocks shorter than this (∛V) in the unit of their file were drawn in metres.
_METRES = 5.0


@dataclass(frozen=True)
class BlockCheck:
    """The blocks of a file or of a scene of files, and what is wrong with them."""

    path: Path
    """Of the file or of the scene."""
    read: FileBlocks
    overlaps: list[Overlap] = field(default_factory=list)
    """Pairs deeper in each other than the contact tolerance."""
    gaps: list[tuple[int, int, float]] = field(default_factory=list)
    """Pairs of blocks that nearly touch, and their distance [mm]."""
    n_touching: int = 0
    """Pairs of blocks that touch."""
    assembly: PolyhedralAssembly | None = None
    """The blocks without faults."""

    @property
    def blocks(self) -> list[Polyhedron]:
        """Shape of each block."""
        return [block for block, _, _ in self.read.placed.blocks]

    @property
    def clean(self) -> bool:
        """Whether nothing is wrong."""
        return not any(self.read.faults) and not self.overlaps

    @property
    def length(self) -> float:
        """∛V of a block of mean volume [mm]; 0 where no block is closed."""
        return 0.0 if self.assembly is None else self.assembly.characteristic_length

    def likely_unit(self) -> str:
        """Unit that the size of the blocks suggests, empty where it agrees with the one stated."""
        likely = "m" if 0.0 < self.length / UNITS[self.read.units] < _METRES else ""
        return likely if likely != self.read.units else ""

    def as_dict(self) -> dict[str, Any]:
        """All of it as plain data."""
        return {
            "file": str(self.path),
            "clean": self.clean,
            "blocks": [
                {
                    "name": block.given_name or block.name,
                    "support": bool(self.read.placed.fixed[k]),
                    "volume": None if self.read.faults[k] else block.volume,
                    "lowest_point": self._lowest(k).tolist(),
                    "triangles": len(block.triangles),
                    "faults": self.read.faults[k],
                    "repairs": list(block.repairs),
                }
                for k, block in enumerate(self.blocks)
            ],
            "left_out": self.read.left_out,
            "size": self.size.tolist(),
            "tolerance": None if self.assembly is None else self.assembly.tolerance,
            "touching_pairs": self.n_touching,
            "overlaps": [
                {"blocks": [o.block_a, o.block_b], "depth": o.depth, "point": o.point.tolist()}
                for o in self.overlaps
            ],
            "gaps": [{"blocks": [a, b], "gap": gap} for a, b, gap in self.gaps],
            "likely_unit": self.likely_unit() or self.read.units,
        }

    @property
    def size(self) -> np.ndarray[Any, Any]:
        """Edges of the box round all blocks [mm]."""
        return np.ptp(np.concatenate([*map(self._points, range(len(self.blocks)))]), axis=0)

    def _points(self, k: int) -> FloatArray:
        """Vertices of a block where it stands, (n, 3) [mm]."""
        block, turn, shift = self.read.placed.blocks[k]
        return block.points @ turn.T + shift

    def _lowest(self, k: int) -> FloatArray:
        """Lowest vertex of a block, (3,) [mm]."""
        points = np.round(self._points(k), 6) + 0.0
        return points[int(np.argmin(points[:, 2]))]

    def table(self) -> RowTable:
        """All of it as text, what is wrong first."""
        bad = [k for k, faults in enumerate(self.read.faults) if faults]
        closed = [k for k, faults in enumerate(self.read.faults) if not faults]
        repaired = [k for k, block in enumerate(self.blocks) if block.repairs]
        rows = [Row("blocks", f"{len(closed)} closed, {len(bad)} not")]
        likely = self.likely_unit()
        if likely:
            words = f"{likely}: such small blocks are rare; --units {likely}"
            rows.append(Row("likely unit", f"{words}, block.units in a scene"))
        rows += [Row(self._name(k), "; ".join(self.read.faults[k])) for k in bad[:_MOST]]
        for k in closed[:_MOST]:
            volume, (x, y, z) = self.blocks[k].volume, self._lowest(k).tolist()
            words = f"{volume:.5g} mm³, lowest at z = {z:.5g} mm (x {x:.5g}, y {y:.5g})"
            rows.append(Row(self._name(k), words, volume, "mm³"))
        for k in repaired[:_MOST]:
            words = ", ".join(self.blocks[k].repairs)
            rows.append(Row(f"repaired: {self._name(k)}", words))
        if max(len(bad), len(closed), len(repaired)) > _MOST:
            rows.append(Row("more", f"only {_MOST} of them are listed; --json FILE has all"))
        if self.assembly is not None:
            rows += self._joint_rows(self.assembly)
        size = " × ".join(f"{x:.5g}" for x in self.size)
        rows.append(Row("size", f"{size} mm (x, y, z)"))
        if self.read.left_out:
            rows.append(Row("left out", ", ".join(self.read.left_out)))
        held = int(self.read.placed.fixed.sum())
        of = "scene" if self.path.suffix == ".toml" else "file"
        rows.append(Row("supports", f"{held} by the {of}" if held else f"the {of} names none"))
        return RowTable(f"{self.path}: {len(self.blocks)} blocks", rows)

    def _joint_rows(self, assembly: PolyhedralAssembly) -> list[Row]:
        """Where blocks touch, overlap, and nearly touch."""
        words = f"{self.n_touching} pairs within {assembly.tolerance:.3g} mm"
        rows = [Row("touching", words, self.n_touching)]
        for o in self.overlaps[:_MOST]:
            pair = f"{self._name(o.block_a)} and {self._name(o.block_b)}"
            near = np.round(o.point, 2).tolist()
            words = f"{pair}: {o.depth:.3g} mm deep near {near} mm{o.words and f'; {o.words}'}"
            rows.append(Row("overlap", words, o.depth, "mm"))
        facing = "" if self.overlaps else facing_words(assembly)
        if facing:
            rows.append(Row("facing area not in contact", facing))
        for a, b, gap in self.gaps[:_MOST]:
            words = f"{self._name(a)} and {self._name(b)}: {gap:.3g} mm apart"
            rows.append(Row("gap", words, gap, "mm"))
        own = self.path.suffix.lower() in {*OWN_UNITS, *STEP_SUFFIXES}
        words = f"{self.length:.4g} mm{'' if own else f' ({self.read.units} in the file)'}"
        return [*rows, Row("∛V of a block", words, self.length, "mm")]

    def _name(self, k: int) -> str:
        block = self.blocks[k]
        return f"block {k}" + (f" ({block.given_name})" if block.given_name else "")


def check_file(path: Path, *, units: str, up: str, repair: bool) -> BlockCheck:
    """Read a file and look for all that keeps its blocks from being analysed."""
    try:
        result = diagnosed_blocks(path, units=units, repair=repair)
        out = left_out(path)
    except MeshError as error:
        raise InputError(str(error)) from None
    blocks = [block for block, _ in result]
    names = tuple(block.given_name for block in blocks)
    placed = PlacedSolids(
        [(block, Y_UP if up == "y" else np.eye(3), np.zeros(3)) for block in blocks],
        np.array([block.held for block in blocks], dtype=np.bool_),
        names if any(names) else (),
        (0,) * len(blocks),
    )
    faults = [of_block for _, of_block in result]
    return _with_neighbours(BlockCheck(path, FileBlocks(placed, faults, out, units)))


def check_case(case: Case, path: Path) -> BlockCheck | None:
    """Look at all blocks of a scene of files, where it places them; None: it has no files."""
    blocks = case.file_blocks
    return None if blocks is None else _with_neighbours(BlockCheck(path, blocks))


def _with_neighbours(check: BlockCheck) -> BlockCheck:
    """Add overlaps and gaps between the blocks that have no fault."""
    placed = check.read.placed
    number = [k for k, faults in enumerate(check.read.faults) if not faults]
    if not number:
        return check
    shapes, turns, shifts = zip(*(placed.blocks[k] for k in number), strict=True)
    assembly = PolyhedralAssembly(
        name=check.path.stem,
        shapes=shapes,
        shape_of=np.arange(len(number)),
        rotations=np.array(turns),
        translations=np.array(shifts),
        fixed=placed.fixed[number],
        names=tuple(placed.names[k] for k in number) if placed.names else (),
        detection=check.read.detection,
    )
    overlaps, gaps, touching = _neighbours(assembly)
    return replace(
        check,
        overlaps=[
            replace(o, block_a=number[o.block_a], block_b=number[o.block_b]) for o in overlaps
        ],
        gaps=[(number[a], number[b], gap) for a, b, gap in gaps],
        n_touching=len(touching),
        assembly=assembly,
    )


_Pairs = list[tuple[int, int]]


def _neighbours(
    assembly: PolyhedralAssembly,
) -> tuple[list[Overlap], list[tuple[int, int, float]], _Pairs]:
    """Overlaps, gaps that are nearly joints, and pairs of blocks that touch."""
    overlaps = find_overlaps(assembly, assembly.tolerance)
    touching = _pairs(assembly, assembly.tolerance)
    near = set(_pairs(assembly, _GAPS * assembly.tolerance)) - set(touching)
    near -= {(o.block_a, o.block_b) for o in overlaps}
    return overlaps, [(a, b, distance_between(assembly, a, b)) for a, b in sorted(near)], touching


def _pairs(assembly: PolyhedralAssembly, tolerance: float) -> _Pairs:
    contacts = assembly.contacts_within(tolerance)
    pairs = np.sort(np.column_stack([contacts.block_m, contacts.block_s]), axis=1)
    return [(a, b) for a, b in np.unique(pairs, axis=0).tolist()]


def write_repaired(path: Path, output: Path, *, units: str, up: str) -> BlockCheck:
    """Mend the blocks of a file and write them again, in mm with z up."""
    if output.suffix.lower() not in SOLID_SUFFIXES:
        raise InputError(f"--repair {output}: expected a name that ends in .obj or .json (compas)")
    check = check_file(path, units=units, up=up, repair=True)
    for k, faults in enumerate(check.read.faults):
        if faults:
            raise InputError(
                f"{path}: block {k} ({check.blocks[k].name}) cannot be repaired: {faults[0]}"
            )
    assert check.assembly is not None
    prepare_file(output)
    write_solids(output, check.assembly)
    return check
