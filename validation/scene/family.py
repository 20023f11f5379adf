"""Families of blocks: one record says of which dataclass of geometry their scenes are made.

A record is one call of `family`, in `validation.scene.families`. Nothing else lists families.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self, get_type_hints

import numpy as np
from pydantic import Field, create_model

from validation.errors import keyed
from validation.scene.deformable import DeformableSections
from validation.scene.sections import (
    Section,
    TubeLoadSection,
    WallLoadSection,
    fewer,
    section_of,
    unset,
)

if TYPE_CHECKING:
    from geometry.assembly import Assembly
    from geometry.loads import LoadCase


class Families(Mapping[str, Any]):
    """Scene class of each family by the type of its block, made when it is first read.

    A command needs one of them, and a file of the type's name is looked at first.
    """

    def __init__(self) -> None:
        self._makers: dict[str, Callable[[], Any]] = {}
        self._made: dict[str, Any] = {}
        self._bases: dict[str, type[FamilyScene]] = {}

    def add(
        self, types: str, base: type[FamilyScene], make: Callable[[], Any] | None = None
    ) -> None:
        """Add a family, whose scene class is made from a base or is the base itself."""
        for kind in types.split():
            self._bases[kind], self._makers[kind] = base, make or (lambda: base)

    @property
    def bases(self) -> dict[str, type[FamilyScene]]:
        """What the scene classes of all types are made from; none of them is made.

        Types of hexahedra come first.
        """
        _import_records()
        solid = {kind: not issubclass(base, AssemblyScene) for kind, base in self._bases.items()}
        return {kind: self._bases[kind] for kind in sorted(solid, key=lambda k: (solid[k], k))}

    def __getitem__(self, kind: str) -> Any:
        """Return the scene class of a type of block."""
        if kind not in self._made:
            if kind not in self:
                raise KeyError(kind)
            make = self._makers[kind]
            made = make()
            self._made |= {name: made for name, other in self._makers.items() if other is make}
        return self._made[kind]

    def __contains__(self, kind: object) -> bool:
        """Whether there is such a type; nothing is made."""
        if kind not in self._bases:
            _import_records(str(kind))
        return kind in self._bases or kind in self.bases

    def __iter__(self) -> Iterator[str]:
        """Go through the types; nothing is made."""
        return iter(self.bases)

    def __len__(self) -> int:
        """Return how many types there are."""
        return len(self.bases)


#: All families.
FAMILIES = Families()


def _import_records(kind: str = "") -> None:
    """Import the file of a type's name, where there is one; without a type all files."""
    from validation.scene import families

    for module in iter_modules(families.__path__):
        if kind in ("", module.name):
            import_module(f"{families.__name__}.{module.name}")


class FamilyScene(DeformableSections):
    """A scene of blocks that a dataclass of geometry states."""

    #: The dataclass.
    parameters: ClassVar[type]

    block: Any
    load: Any

    @property
    def stated(self) -> Any:
        """The dataclass, with the values of the sections."""
        scene: Any = self
        sections = [getattr(scene, name, None) for name in ("block", "assembly", "mesh")]
        inner, given = _inner(self.parameters), {}
        with keyed(self.keys):
            for key in _names(self.parameters):
                if key in inner:
                    section, kind = inner[key]
                    stated = getattr(scene, section)
                    names = type(stated).model_fields.keys() - {"type"}
                    given[key] = kind(**{name: getattr(stated, name) for name in names})
                else:
                    given[key] = next(getattr(s, key) for s in sections if hasattr(s, key))
            return self.parameters(**given)

    @property
    def keys(self) -> dict[str, str]:
        """Key of the scene for each field of the dataclass."""
        scene: Any = self
        sections = {name: getattr(scene, name, None) for name in ("block", "assembly", "mesh")}
        return {
            key: f"{name}.{key}"
            for name, section in sections.items()
            for key in getattr(type(section), "model_fields", ())
        }

    @property
    def files(self) -> tuple[Any, ...]:
        """Files that hold the blocks, `PartSection`; families have none."""
        return ()

    def located(self, folder: Path) -> Self:  # noqa: ARG002
        """Return the same scene with absolute file names, relative ones taken from a folder."""
        return self

    @property
    def element_counts(self) -> dict[str, Any]:
        """Values of ``[mesh]`` that count elements; none where meshes are given block by block."""
        counts: dict[str, Any] = getattr(getattr(self, "mesh", None), "counts", {})
        return counts

    #: Whether blocks are solids, which are meshed for deformable answers alone.
    solid: ClassVar[bool] = False

    @property
    def divisions(self) -> list[int]:
        """Elements of a block in three directions; none where they are not known beforehand."""
        given = [n for v in self.element_counts.values() for n in np.atleast_1d(v).tolist()]
        return 3 * given if len(given) == 1 else given

    @property
    def block_counts(self) -> list[int]:
        """Numbers whose product is that of blocks, the frame's too, or more."""
        scene: Any = self
        assembly: Any = getattr(scene, "assembly", None)
        if hasattr(assembly, "rings"):
            return [3, assembly.rings + 1, assembly.rings + 1]
        names = ("layers", "columns", "rows", "voussoirs", "copies")
        given = (getattr(assembly, name, None) for name in names)
        each = getattr(scene.block, "blocks_per_layer", 1)
        return [each, *(n + 2 for n in given if isinstance(n, int))]

    def _with_counts(self, change: Callable[[int, int], int]) -> dict[str, Any]:
        """Values of ``[mesh]`` that change: of a count and its axis, along, across or up."""
        axes, result = iter(range(3)), {}
        for key, value in self.element_counts.items():
            many = isinstance(value, tuple)
            new = tuple(change(n, next(axes)) for n in (value if many else (value,)))
            if new != (value if many else (value,)):
                result[key] = new if many else new[0]
        return result

    @property
    def parts_of_a_block(self) -> tuple[int, int, int]:
        """Equal parts along, across and up, such as its waves."""
        one = (1, 1, 1)
        return getattr(self.stated, "parts", one) if self.element_counts else one

    def coarse_mesh(self, wave: int, through: int, other: int) -> dict[str, Any]:
        """Values of ``[mesh]`` that are lower with at most so many elements.

        Parameters
        ----------
        wave
            Along a wave of the joints, or along an edge.
        through
            Through the thickness.
        other
            In the direction that is left.
        """
        parts = self.parts_of_a_block
        limits = (parts[0] * wave, max(parts[1], through), other)
        return self._with_counts(lambda n, axis: min(n, limits[axis]))

    def fewer_elements(self, share: float) -> dict[str, Any]:
        """Values of ``[mesh]`` that change with about that share of the elements along every edge.

        Waves keep whole numbers of elements.
        """
        multiples = (self.parts_of_a_block[0], 1, 1)
        return self._with_counts(lambda n, axis: fewer(n, share, multiples[axis]))

    def coarser(self, share: float) -> Self | None:
        """Return the scene with about that share of the elements along every edge.

        None where it has no fewer: meshes that are given node by node have no coarser one.
        """
        mesh = getattr(self, "mesh", None)
        result = {k: v for k, v in self.fewer_elements(share).items() if v != getattr(mesh, k)}
        return self.changed({"mesh": result}) if result else None


class MeshSection(Section):
    """``[mesh]``: elements of a block."""

    @property
    def counts(self) -> dict[str, Any]:
        """Values that count elements."""
        return {k: v for k, v in self.model_dump().items() if not isinstance(v, float)}

    @property
    def words(self) -> str:
        """Elements of a block in each direction."""
        return ", ".join(
            f"{' × '.join(map(str, np.atleast_1d(v)))} {k}" for k, v in self.counts.items()
        )


def family(
    base: type[FamilyScene],
    types: str,
    parameters: str,
    *,
    assembly: str = "",
    mesh: str = "",
    default: Mapping[str, Any] | Callable[[Any], Mapping[str, Any]] | None = None,
    about: Mapping[str, Any] | None = None,
) -> None:
    """List a family, whose sections have the fields of a dataclass.

    Parameters
    ----------
    base
        What such scenes state and do besides.
    types
        Types of ``[block]`` that are scenes of this class.
    parameters
        Module and name of the dataclass, ``"geometry.families.tube:SineTube"``.
    assembly, mesh
        Its fields that are keys of these sections, the others are of ``[block]``; unless its fields
        ``block`` and ``divisions`` are dataclasses of ``[block]`` and ``[mesh]``.
    default
        Values of ``[mesh]`` in scenes without one, or what makes them from ``[block]``.
    about
        Plausible ranges of fields.
    """
    keys = {"assembly": assembly.split(), "mesh": mesh.split()}
    make = partial(_scene_class, base, types, parameters, keys=keys, default=default, about=about)
    FAMILIES.add(types, base, make)


def _scene_class(
    base: type[FamilyScene],
    types: str,
    place: str,
    *,
    keys: Mapping[str, list[str]],
    default: Mapping[str, Any] | Callable[[Any], Mapping[str, Any]] | None,
    about: Mapping[str, Any] | None,
) -> Any:
    """Make the scene class of a family; `family` has the arguments."""
    module, _, name = place.partition(":")
    parameters: Any = getattr(import_module(module), name)
    inner = dict(_inner(parameters).values())
    others = [n for n in _names(parameters) if n not in (*keys["assembly"], *keys["mesh"])]
    keys = {**keys, "block": others, **{name: _names(kind) for name, kind in inner.items()}}

    def section(name: str, of: type[Section] = Section, **more: Any) -> Any:
        title, kind = f"{parameters.__name__}{name.title()}", inner.get(name, parameters)
        made = section_of(kind, keys=keys[name], about=about, base=of, name=title, **more)
        made.__doc__ = f"``[{name}]`` of blocks of type ``{types.replace(' ', '`` or ``')}``."
        return made

    block = section("block", type=(Literal[*types.split()], ...))
    result: dict[str, Any] = {"block": (block, ...)}
    if keys["assembly"]:
        result["assembly"] = _stated(section("assembly"))
    if keys["mesh"]:
        made = section("mesh", MeshSection)
        result["mesh"] = _stated(made)
        if callable(default):
            chosen = default
            result["mesh"] = (
                made,
                Field(default_factory=lambda scene: made(**chosen(scene["block"]))),
            )
        elif default is not None:
            result["mesh"] = made, made(**default)
    scene = create_model(
        f"{parameters.__name__}Scene", __base__=base, __doc__=parameters.__doc__, **result
    )
    scene.parameters = parameters
    return scene


def _inner(kind: type) -> dict[str, tuple[str, Any]]:
    """Section and dataclass of each field that has a section of its own."""
    hints = get_type_hints(kind)
    places = {"block": "block", "divisions": "mesh"}
    return {n: (p, hints[n]) for n, p in places.items() if is_dataclass(hints.get(n))}


def _names(kind: type) -> list[str]:
    return [field.name for field in fields(kind)]


def _stated(section: Any) -> tuple[Any, Any]:
    """Annotation and default of a section, which scenes need not have where no key is required."""
    needed = any(key.is_required() for key in section.model_fields.values())
    return section, ... if needed else unset(section)


class AssemblyScene(FamilyScene):
    """A scene of blocks with hexahedra."""

    def build(self) -> Assembly:
        """Build the blocks."""
        with keyed(self.keys):
            result: Assembly = self.stated.build()
        return result

    def build_load(self, assembly: Assembly) -> LoadCase:
        """Put the load case on the blocks, where ``[load]`` names one."""
        from geometry.loads import LoadCase, named_load

        load = self.load
        if not isinstance(load, TubeLoadSection):
            return LoadCase(assembly, "none", (), assembly.fixed.copy())
        with keyed({key: f"load.{key}" for key in type(load).model_fields}):
            return named_load(
                load.case, load.pressure, as_printed=load.as_printed, layer=load.layer
            ).on(assembly)


class WallScene(AssemblyScene):
    """A planar wall with a load case of tubes."""

    load: WallLoadSection


class RoundScene(AssemblyScene):
    """A scene of blocks that stand round an axis, with inner and outer faces, in layers."""

    assembly: Any
    mesh: Any
    load: TubeLoadSection

    @property
    def thickness(self) -> float:
        """Of the wall [mm]."""
        return float(self.block.thickness)

    def build_cell(self) -> Assembly:
        """Build the two layers that a long tube repeats, and their images."""
        with keyed(self.keys):
            result: Assembly = self.stated.cell()
        return result


def round_types() -> str:
    """Types of block that make tubes, in words."""
    result = [kind for kind, base in FAMILIES.bases.items() if issubclass(base, RoundScene)]
    return " or ".join(f'"{kind}"' for kind in sorted(result, reverse=True))
