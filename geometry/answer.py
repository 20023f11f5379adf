"""An answer as plain data, whichever solver found it: measures, fields, contacts, report.

Rigid, static and explicit answers have one type. What takes time to compute (stresses at nodes,
averages over balls) is computed when it is first read. An answer can be pickled: everything is
then computed once, and only the solver's own result is left behind.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, TypeVar, final

import numpy as np
import numpy.typing as npt

from geometry.assembly import Assembly, interface_surface
from geometry.errors import RefusedError
from geometry.mesh import FloatArray, IntArray, QuadSurface, read_only
from geometry.parts.measures import Planes, SectionError, SectionForces, first_largest, planes
from geometry.parts.placed import AnyBlocks
from geometry.parts.rows import TIMES, Part, Row, RowTable, number, time_row

if TYPE_CHECKING:
    import pyvista as pv

Value = TypeVar("Value")
Array = npt.NDArray[Any]


class AnswerError(RefusedError, KeyError):
    """A name that an answer does not have: which ones it has."""

    __str__ = RefusedError.__str__


#: A value with an error bar of a larger share than this is not resolved [-].
WIDEST = 0.3


@dataclass(frozen=True)
class Measure:
    """One number of an answer."""

    value: float
    """In its unit."""
    unit: str
    """``MPa`` or ``mm``; ``times the load`` of load factors."""
    error: float | None = None
    """Estimate of the error of discretisation, in the same unit; None where none was asked for."""
    place: dict[str, Any] | None = None
    """Where the value is, of measures that have a place: blocks, layer, face (None where there is
    none), position (3,) [mm], and in tubes radius [mm], angle [degrees] and height [mm]."""
    resolved: bool = True
    """Whether the mesh resolves the value; else it is that of an integration point."""
    remark: str = ""
    """Why the value is none to use, such as one that grows with every refinement."""

    def __float__(self) -> float:
        """Return the value."""
        return self.value

    def __str__(self) -> str:
        """Value, error, unit and place in words."""
        return f"{self.value_words} {self.place_words}".rstrip()

    def as_json(self) -> dict[str, Any]:
        """Return plain data; a place only where there is one."""
        value = self.value if np.isfinite(self.value) else None
        result: dict[str, Any] = {"value": value, "error": self.error, "unit": self.unit}
        if not self.resolved:
            result["resolved"] = False
        if self.remark:
            result["remark"] = self.remark
        return result if self.place is None else result | {"place": self.place}

    @property
    def is_number(self) -> bool:
        """Whether the value is one to use: resolved, without remark, its bar `WIDEST` at most."""
        wide = self.error is not None and self.error > WIDEST * abs(self.value)
        return self.resolved and not self.remark and not wide

    @property
    def value_words(self) -> str:
        """Value with its error and unit: no digits that the error leaves out, five at most.

        Four of a value without an error bar.

        A value that the mesh does not resolve, or whose error bar is wide, is no number to use.
        """
        value, error = self.value, self.error
        if not self.is_number:
            return self.remark or f"not resolved on this mesh: {self._unresolved}"
        if error is None or not error > 0.0:
            return f"{number(value)} {self.unit}"
        if error < 1e-5 * abs(value):
            return f"{value:.5g} {self.unit} ± {100 * error / abs(value):.1g} %"
        digits = max(0, 1 - int(np.floor(np.log10(error))))
        return f"{value:.{digits}f} ± {error:.{digits}f} {self.unit}"

    @property
    def _unresolved(self) -> str:
        """What is known of a value that is no number to use."""
        value, error = self.value, self.error
        if not self.resolved or error is None:
            return f"at least {value:.2g} {self.unit}"
        share = f"{100 * error / abs(value):.0f} %" if value else f"{error:.2g} {self.unit}"
        return f"{value:.2g} {self.unit} ± {share}"

    @property
    def place_words(self) -> str:
        """Where the value is, in words; nothing for measures without a place."""
        where = self.place
        if where is None:
            return ""
        if "displacement" in where:
            return f"{where['support']}, after {where['displacement']:.4g} mm"
        blocks = " and ".join(map(str, where.get("names") or where["blocks"]))
        words = f"block{'s' if len(where['blocks']) > 1 else ''} {blocks}"
        if where["layer"] is not None and "radius" in where:
            words += f", layer {where['layer']}"
        if where["face"] not in (None, "surface"):
            words += f", face {where['face']}"
        if where.get("moved"):
            words += " (elsewhere than under the load as stated)"
        if where.get("interference"):
            words += " (the interference stays as it is)"
        if "radius" in where:
            height = f"z {where['height']:.1f}"
            return f"{words}, r {where['radius']:.1f}, {where['angle']:.1f}°, {height}"
        return f"{words}, at ({', '.join(f'{x:.1f}' for x in where['position'])})"


@dataclass(frozen=True)
class Title:
    """How a measure is named where people read, its unit, and which end of its values governs."""

    words: str
    unit: str = ""
    """Empty where it has none."""
    remark: str = ""
    """Remark on the measure; may contain numbers of its place."""
    least: bool = False
    """Whether the least value governs; else the largest in size."""


#: Measures in the order of a table: what most come for stands first.
TITLES = {
    "p_max_point": Title("largest contact pressure at a point", "MPa"),
    "sigma_1_averaged": Title(
        "max. principal stress, averaged",
        "MPa",
        "over {averaged_over}; ",
    ),
    "max_displacement": Title("largest displacement", "mm"),
    "sigma_1_max": Title("max. principal stress σ₁ at a point", "MPa"),
    "sigma_3_min": Title("min. principal stress σ₃ at a point", "MPa"),
    "mises_max": Title("von Mises stress at a point", "MPa"),
    "p_max_facet": Title("largest mean pressure of a facet", "MPa"),
    "p_max": Title("p_max of the paper", "MPa", "mean over blocks of their largest facet mean"),
    "p_eff": Title("p_eff of the paper", "MPa", "mean over the effective facets"),
}
#: Those of the paper are means over facets and blocks: a peak hardly shows, so they come last.
PAPER = ("p_max", "p_eff")
#: Measures that rigid answers have beside pressures.
FORCES = {
    "least_joint_force": Title("least normal force of a joint", "N", least=True),
    "largest_joint_force": Title("largest normal force of a joint", "N"),
    "total_reaction": Title("total reaction", "N"),
}

#: Measures that answers have whose supports move.
MOTIONS = {
    "push_peak": Title("largest force of the moving support", "N"),
    "push_stiffness": Title("its stiffness in the first step", "N/mm"),
    "push_work": Title("its work", "N mm"),
}

#: Measures that static answers have of materials with strengths.
FACTORS = {
    "cracking_factor": Title("load factor at first cracking", least=True),
    "crushing_factor": Title("load factor at first crushing", "", "by {stress}; ", least=True),
}

#: What is built, and means of rigid blocks: columns of studies.
OTHERS = {
    "volume": Title("volume", "mm³"),
    "least_wall": Title("least wall", "mm", least=True),
    "steepest_joint": Title("steepest joint", "degrees"),
    "p_eff_pooled": Title("p eff pooled", "MPa"),
    "effective_count_percent": Title("effective count percent", "%"),
    "effective_area_percent": Title("effective area percent", "%"),
}

#: Every measure that has a title, in the order of a table.
EVERY_TITLE = {name: title for name, title in TITLES.items() if name not in PAPER}
EVERY_TITLE |= FACTORS | FORCES | MOTIONS | {name: TITLES[name] for name in PAPER} | OTHERS


def title_of(measure: str) -> Title:
    """Title of a measure; of one that has none, its name."""
    return EVERY_TITLE.get(measure, Title(measure))


#: Other names of measures.
ALIASES = {"u": "max_displacement"}

#: Units of fields and of what contacts have.
UNITS = {
    "displacement": "mm",
    "stress": "MPa",
    "principal_stress": "MPa",
    "mises": "MPa",
    "pressure": "MPa",
    "area": "mm²",
    "centroid": "mm",
    "corners": "mm",
    "force": "N",
    "gap": "mm",
    "slip": "mm",
    "mechanism": "-",
}


def by_size(measures: Mapping[str, Measure]) -> list[str]:
    """Names of load factors, the limit that is reached first before the others."""
    return sorted(FACTORS, key=lambda n: least_factor(measures[n]) if n in measures else np.inf)


def least_factor(measure: Measure) -> float:
    """Smallest load factor that a measure does not rule out: 0 where nothing is known of it."""
    return 0.0 if np.isnan(measure.value) else measure.value


def measure_rows(measures: Mapping[str, Measure]) -> list[Row]:
    """Measures, a row each: value, error, unit, remark and place in words.

    Those that no mesh resolves share a row.
    """
    result, unresolved = list[Row](), dict[str, list[str]]()
    names = [*EVERY_TITLE, *(name for name in measures if name not in EVERY_TITLE)]
    first = names.index(next(iter(FACTORS)))
    names[first : first + len(FACTORS)] = by_size(measures)
    for name in names:
        if name in measures:
            measure, title = measures[name], title_of(name)
            if name in TITLES and not measure.is_number:
                known = title.words if measure.remark else f"{title.words} ({measure._unresolved})"
                unresolved.setdefault(measure.remark, []).append(known)
                continue
            reported = "" if measure.remark else title.remark.format(**(measure.place or {}))
            words = f"{measure.value_words} {reported}{measure.place_words}".rstrip()
            value = measure.value if measure.is_number else None
            result.append(Row(title.words, words.removesuffix(";"), value, measure.unit))
    for remark, titles in unresolved.items():
        why = remark.removeprefix("not resolved ").strip("()")
        words = f"{'; '.join(titles)}{why and f': {why}'}"
        result.append(Row("not resolved on this mesh", words))
    return result


class Lazy(Mapping[str, Value]):
    """Values by name, each computed when it is first read; arrays are read-only."""

    def __init__(
        self,
        makers: Mapping[str, Callable[[], Value]],
        known: Mapping[str, Value] | None = None,
    ) -> None:
        self._makers = dict(makers)
        self._known: dict[str, Value] = {k: read_only(v) for k, v in (known or {}).items()}
        self._names = tuple(dict.fromkeys((*self._makers, *self._known)))

    def __getitem__(self, name: str) -> Value:
        """Return a value; computed once."""
        if name not in self._known:
            if name not in self._makers:
                raise AnswerError(f"got {name!r}; expected one of {', '.join(self._names)}")
            self._known[name] = read_only(self._makers[name]())
        return self._known[name]

    def beside(
        self, known: Mapping[str, Value], makers: Mapping[str, Callable[[], Value]] | None = None
    ) -> Lazy[Value]:
        """Return the same values and others, which are computed already or have makers."""
        own = {name: partial(self.__getitem__, name) for name in self}
        return Lazy(own | dict(makers or {}), known) if known or makers else self

    def __contains__(self, name: object) -> bool:
        """Whether there is such a name; nothing is computed."""
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        """Go through the names."""
        return iter(self._names)

    def __len__(self) -> int:
        """Return how many names there are."""
        return len(self._names)

    def __repr__(self) -> str:
        """Names with their units; values are not computed for it."""
        shown = (f"{name} [{UNITS[name]}]" if name in UNITS else name for name in self)
        return f"<{', '.join(shown)}>"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the values, all of them computed."""
        return Lazy, ({}, dict(self))


#: Components of arrays of contacts, and the unit that the names of their columns have.
_COLUMNS: dict[str, tuple[tuple[str, ...], str]] = {
    "blocks": (("block_m", "block_s"), ""),
    "layer": (("layer_m", "layer_s"), ""),
    "facet": (("facet_m", "facet_s"), ""),
    "area": (("area",), "_mm2"),
    **{
        name: ((f"{name}_x", f"{name}_y", f"{name}_z"), unit)
        for name, unit in (("centroid", "_mm"), ("normal", ""), ("force", "_N"), ("slip", "_mm"))
    },
    "pressure": (("pressure",), "_MPa"),
    "gap": (("gap",), "_mm"),
}


def known(values: Mapping[str, Value]) -> Lazy[Value]:
    """Values that are computed already."""
    return Lazy({}, values)


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Answer:
    """Result of a solver: rigid, static or explicit; world axes, mm, N, MPa.

    ``print(answer)`` shows its table, ``answer["p_max_point"]`` is one measure.
    """

    title: str
    """Description of the problem in one line."""
    method: str
    """``rigid``, ``static`` or ``explicit``."""
    measures: Mapping[str, Measure]
    """Numbers by name (`TITLES`): value, error, unit, place."""
    fields: Mapping[str, Array]
    """Values at `points` by name, each (n_points, …): ``displacement`` (n, 3) [mm], ``stress``
    (n, 6) in the order xx, yy, zz, xy, yz, xz, ``principal_stress`` (n, 3) σ₁ ≥ σ₂ ≥ σ₃, tension
    positive, and ``mises`` (n,) [MPa] of deformable blocks; ``mechanism`` (n, 3) of rigid blocks
    that move, largest 1 [-]."""
    arrays: Mapping[str, Array]
    """`points`, `cells`, `block_of_point` and `layer_of_point` by these names."""
    contacts: Lazy[Array]
    """Values of the contact facets by name, each (n_contacts, …), in the order of the assembly's
    `interfaces` for every solver, before the load acts: ``pressure`` [MPa], compression positive,
    ``area`` [mm²], ``blocks`` (n, 2), their ``layer`` (n, 2), the ``facet`` (n, 2) of each in its
    `Block.contact_quads`, -1 where a search found none, and its face, ``side`` (n, 2),
    ``centroid`` (n, 3) [mm], ``normal`` (n, 3) from the first block to the second one, ``corners``
    (n, 4, 3) [mm]. Of facets that were solved also the ``force`` on the second block, (n, 3) [N],
    and of deformable blocks the smallest ``gap`` [mm], positive where the facet is open, and the
    ``slip`` of the second block along the facet, relative to the first, (n, 3) [mm]. Flat patches
    of triangulated blocks have no layer, facet, side and corners. Empty where blocks do not
    meet."""
    reported: Callable[[], Lazy[Any]]
    """Makes `report`."""
    details: Any = None
    """The solver's own result; None in an answer that was pickled or read."""
    problem: Any = None
    """What was solved, with its ``blocks`` on the facets of `contacts`; None in such an answer."""
    cut: Callable[[Planes], SectionForces] | None = None
    """Makes section forces; None in such an answer."""
    parts: Mapping[str, Part] = field(default_factory=dict)
    """What was found beside the measures, by name; none in such an answer."""
    case: Any = None
    """What was asked (`validation.Case`); None in such an answer, and where a solver was called."""
    tabled: Callable[[Answer], Sequence[Row]] = lambda answer: measure_rows(answer.measures)
    """Makes the rows of its table, but those of its parts and of CPU times."""

    @property
    def points(self) -> FloatArray:
        """Nodes of the blocks before the load acts, block after block, (n_points, 3) [mm].

        Blocks share none.
        """
        return self.arrays["points"]

    @property
    def cells(self) -> IntArray:
        """Points of each hexahedron (n_cells, 8), or triangle (n_cells, 3)."""
        return self.arrays["cells"]

    @property
    def block_of_point(self) -> IntArray:
        """Number of the block of each point, (n_points,)."""
        return self.arrays["block_of_point"]

    @property
    def layer_of_point(self) -> IntArray:
        """Layer of each point, (n_points,): 0 the lower frame."""
        return self.arrays["layer_of_point"]

    def __getitem__(self, name: str) -> Measure:
        """Return a measure by its name, ``u`` for ``max_displacement``."""
        return self.measures[ALIASES.get(name, name)]

    @cached_property
    def report(self) -> Lazy[Any]:
        """How it was computed, its parts included: residual, iterations, times, as plain data.

        The dimensions of the blocks are measured when they are first read.
        """
        return self.reported().beside({}, {name: part.as_json for name, part in self.parts.items()})

    def with_report(self, more: Mapping[str, Any]) -> Answer:
        """Return the same answer with more, plain data, in its report."""
        reported = self.reported
        return replace(self, reported=lambda: reported().beside(more)) if more else self

    def beside(self, parts: Mapping[str, Part]) -> Answer:
        """Return the same answer with more parts, or others of the same names."""
        return replace(self, parts={**self.parts, **parts})

    @cached_property
    def table(self) -> RowTable:
        """Its rows under its title: what a command prints; dear rows are computed when first read.

        The groups are verdict, measures, evidence, model and time.
        """
        rows = [*self.tabled(self), *(row for part in self.parts.values() for row in part.rows)]
        if "cpu_seconds" in self.report and not any(row.title == TIMES for row in rows):
            rows.append(time_row(self.report["cpu_seconds"]))
        return RowTable(self.title, rows)

    @property
    def rows(self) -> dict[str, list[Row]]:
        """Rows of `table` by their group."""
        return self.table.groups

    def as_dict(self) -> dict[str, Any]:
        """Return everything but fields and contacts as plain data: what ``--json`` prints.

        ``fields`` has the units of both by name.
        """
        measures = {name: measure.as_json() for name, measure in self.measures.items()}
        units = {name: UNITS.get(name, "") for name in (*self.fields, *self.contacts)}
        head = {"title": self.title, "method": self.method, **self.report, "measures": measures}
        return head | {"rows": self.table.as_json(), "fields": units}

    def __repr__(self) -> str:
        """Return the table as text."""
        return str(self.table)

    def _repr_html_(self) -> str:
        """Return the table for a notebook."""
        return self.table._repr_html_()

    def sections(
        self,
        point: npt.ArrayLike,
        normal: npt.ArrayLike,
        *,
        blocks: Sequence[int] | None = None,
    ) -> SectionForces:
        """Compute normal force, shear forces and moments of the blocks through one or more planes.

        Parameters
        ----------
        point
            Of the plane, (3,), or of n planes, (n, 3) [mm].
        normal
            Of any length, (3,) or (n, 3). Forces are those of what lies ahead of the plane on what
            lies behind it.
        blocks
            Numbers of the blocks that are cut; None: all.

        Raises
        ------
        SectionError
            A plane that cuts nothing, or forces that the answer does not have.
        """
        if self.cut is None:
            raise SectionError(
                "section: an answer that was read or pickled has no forces inside blocks; solve "
                "the problem again, or name the section in the scene"
            )
        return self.cut(planes(point, normal, blocks=blocks))

    def contact_table(self) -> dict[str, Array]:
        """Return numbers of the contacts as columns, such as ``force_x_N``, a row each contact.

        ``pandas.DataFrame(answer.contact_table())`` is their table.
        """
        return {
            name + unit: values if values.ndim == 1 else values[:, k]
            for of, (names, unit) in _COLUMNS.items()
            if of in self.contacts
            for values in (self.contacts[of],)
            for k, name in enumerate(names)
        }

    def mesh(self) -> pv.UnstructuredGrid:
        """Blocks before the load acts as a pyvista mesh, with every field, block and layer.

        ``answer.mesh().warp_by_vector("displacement", factor=1000)`` is the deformed shape.
        """
        import pyvista as pv

        kinds = {8: pv.CellType.HEXAHEDRON, 3: pv.CellType.TRIANGLE}
        grid = pv.UnstructuredGrid({kinds[self.cells.shape[1]]: self.cells}, self.points)
        owners = {"block": self.block_of_point, "layer": self.layer_of_point}
        for name, values in (*owners.items(), *self.fields.items()):
            grid.point_data[name] = values
        return grid

    def contact_mesh(self) -> pv.PolyData:
        """Contact facets as a pyvista mesh, with pressure, area, blocks, layers and normals."""
        import pyvista as pv

        result = self.contacts
        if "corners" in result:
            n, per_facet = result["corners"].shape[:2]
            faces = np.arange(n * per_facet).reshape(n, per_facet)
            surface = pv.PolyData.from_regular_faces(result["corners"].reshape(-1, 3), faces)
            data = surface.cell_data
        else:
            surface = pv.PolyData(np.array(result.get("centroid", np.empty((0, 3)))))
            data = surface.point_data
        for name, values in result.items():
            if values.ndim < 3 and name != "centroid":
                data[name] = values
        return surface

    def numbers_alone(self) -> Answer:
        """Return its measures and its report without fields, contacts and the solver's own result.

        Of many answers these take the memory.
        """
        kept = {"title": self.title, "method": self.method, "measures": known(dict(self.measures))}
        arrays = known(dict.fromkeys(self.arrays, np.zeros(0)))
        nothing = {"arrays": arrays, "fields": {}, "contacts": known({})}
        return restored({**kept, **nothing}, dict(self.report), self.table.rows)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle what is plain: everything computed, without the solver's own result."""
        kept = {name: getattr(self, name) for name in _PLAIN}
        return restored, (kept, dict(self.report), list(self.table.rows))


_PLAIN = ("title", "method", "measures", "fields", "contacts", "arrays")


def restored(kept: Mapping[str, Any], report: dict[str, Any], rows: Sequence[Row]) -> Answer:
    """Return an answer that was pickled or written: its fields, report and rows."""
    return Answer(**kept, reported=partial(known, report), tabled=lambda _: rows)


# ---------------------------------------------------------------------------------------------
# Places and contacts of blocks with hexahedra


def is_round(assembly: Assembly) -> bool:
    """Whether blocks with inner and outer faces stand in rings about the axis of the assembly.

    Their centroids then lie at one distance from it, all round.
    """
    if not all({"inner", "outer"} <= set(shape.faces) for shape in assembly.shapes):
        return False
    arms = assembly.centroids[assembly.free_blocks] - assembly.origin
    arms = arms - np.outer(arms @ assembly.axis, assembly.axis)
    size = np.linalg.norm(arms, axis=1)
    if not len(arms) or not np.ptp(size) <= 1e-6 * size.max() or not size.max() > 0.0:
        return False
    if not np.linalg.norm(arms.sum(axis=0)) < 1e-6 * size.sum():
        return False
    if np.linalg.svd(arms / size.max(), compute_uv=False)[1] > 1e-3:  # of a ring two are equal
        return True
    # A ring of two blocks lies in a line, as a wall does, but its inner faces cancel.
    inner = np.concatenate(
        [
            QuadSurface(assembly.nodes(b), assembly.shape(b).faces["inner"]).area_vectors
            for b in assembly.free_blocks
        ]
    )
    cancelled = np.linalg.norm(inner.sum(axis=0)) < 1e-6 * np.linalg.norm(inner, axis=1).sum()
    return bool(cancelled)


def place(
    assembly: AnyBlocks, blocks: tuple[int, ...], position: FloatArray, face: str | None = None
) -> dict[str, Any]:
    """Say where a value is: blocks, layer, face and position, of tubes also about their axis."""
    result: dict[str, Any] = {
        "blocks": list(blocks),
        "layer": None,
        "face": face,
        "position": position.tolist(),
    }
    if assembly.names:
        result["names"] = [assembly.named(block) for block in blocks]
    if not isinstance(assembly, Assembly):
        return result
    result["layer"] = int(assembly.layer[blocks[0]])
    return result | (about_axis(assembly, position) if is_round(assembly) else {})


def largest_facet_mean(assembly: AnyBlocks, contacts: Mapping[str, Array]) -> Measure:
    """Largest pressure of some contact facets (see `Answer.contacts`), with its place.

    The place also has the ``facet_area`` [mm²] over which it is the mean; without facets the
    pressure is zero and has no place.
    """
    pressures = contacts["pressure"]
    if not len(pressures):
        return Measure(0.0, "MPa")
    worst = first_largest(pressures)
    m, s = contacts["blocks"][worst].tolist()
    face = None
    if isinstance(assembly, Assembly):  # of one facet: names of all take long
        at = contacts["facet"][worst, :1]
        face = str(_face_names(assembly, np.array([m]), at)[0]) or None
    where = place(assembly, (m, s), contacts["centroid"][worst], face)
    where["facet_area"] = float(contacts["area"][worst])
    return Measure(float(pressures.max()), "MPa", place=where)


def about_axis(assembly: Assembly, position: FloatArray) -> dict[str, float]:
    """Radius [mm], angle [degrees] and height [mm] of a point of a tube."""
    from_axis = position - assembly.origin
    height = float(from_axis @ assembly.axis)
    radial = from_axis - height * assembly.axis
    angle = float(np.degrees(np.arctan2(radial[1], radial[0]))) % 360.0
    return {"radius": float(np.linalg.norm(radial)), "angle": angle, "height": height}


def interface_contacts(assembly: Assembly, index: IntArray) -> dict[str, Callable[[], Array]]:
    """Makers of what contacts have beside pressures, of some of the assembly's interfaces (n,)."""
    result = assembly.interfaces
    m, s = result.block_m[index], result.block_s[index]
    return {
        "area": lambda: result.areas[index],
        "blocks": lambda: np.column_stack([m, s]),
        "layer": lambda: np.column_stack([assembly.layer[m], assembly.layer[s]]),
        **facet_sides(assembly, (m, s), (result.facet_m[index], result.facet_s[index])),
        "centroid": lambda: result.centroids[index],
        "normal": lambda: result.normals[index],
        "corners": lambda: interface_surface(assembly, index).nodes.reshape(-1, 4, 3),
    }


def facet_sides(
    assembly: Assembly, blocks: Sequence[IntArray], facets: Sequence[IntArray]
) -> dict[str, Callable[[], Array]]:
    """Makers of ``facet`` and ``side`` of contacts, from blocks and facets (n,) of both sides."""

    def sides() -> Array:
        names = [_face_names(assembly, *side) for side in zip(blocks, facets, strict=True)]
        return np.stack(names, axis=1)

    return {"facet": lambda: np.column_stack(list(facets)), "side": sides}


def _face_names(assembly: Assembly, blocks: IntArray, positions: IntArray) -> Array:
    """Face of each block (n,) that the facet at a position of its `contact_quads` belongs to."""
    of_shape = [
        np.repeat(shape.contact_faces, [len(shape.faces[f]) for f in shape.contact_faces])
        for shape in assembly.shapes
    ]
    starts = np.cumsum([0, *(len(names) for names in of_shape)])
    every: Array = np.concatenate(of_shape)
    return np.where(positions < 0, "", every[starts[assembly.shape_of[blocks]] + positions])
