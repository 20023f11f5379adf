"""What a family of hexahedral blocks is: one record that says how its scenes are read and built.

A family is one file in `validation.scene.families` with one subclass of `AssemblyScene`; the type
of its ``[block]`` names it. Nothing else lists families.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar, get_args

from pydantic import create_model

from validation.scene.deformable import DeformableSections
from validation.scene.sections import (
    Section,
    TubeAssemblySection,
    TubeLoadSection,
    section_of,
)

if TYPE_CHECKING:
    from geometry.assembly import Assembly, UnmatchedJoint
    from geometry.loads import LoadCase


class FamilyScene(DeformableSections):
    """A scene of blocks that a dataclass of geometry states."""

    #: The dataclass.
    parameters: ClassVar[type]

    @property
    def stated(self) -> Any:
        """The dataclass, with the values of the sections."""
        scene: Any = self
        sections = [getattr(scene, name, None) for name in ("block", "assembly", "mesh")]
        names = [field.name for field in fields(self.parameters)]
        given = {n: next(getattr(s, n) for s in sections if hasattr(s, n)) for n in names}
        return self.parameters(**given)


Scene = TypeVar("Scene", bound=FamilyScene)


def family(
    base: type[Scene],
    types: str,
    parameters: type,
    *,
    assembly: Collection[str] = (),
    mesh: Collection[str] = (),
    about: Mapping[str, Any] | None = None,
) -> type[Scene]:
    """Scene class whose ``[block]``, ``[assembly]`` and ``[mesh]`` have the fields of a dataclass.

    Parameters
    ----------
    base
        What is common to such scenes.
    types
        Types of ``[block]`` that are scenes of this class.
    parameters
        Dataclass of geometry that a family is made from.
    assembly, mesh
        Its fields that are keys of these sections; the others are of ``[block]``.
    about
        Plausible ranges of its fields.
    """
    every = [field.name for field in fields(parameters)]
    block = [name for name in every if name not in (*assembly, *mesh)]
    result: dict[str, Any] = {}
    for section, keys in (("block", block), ("assembly", assembly), ("mesh", mesh)):
        kind: dict[str, Any] = {}
        if section == "block":
            kind["type"] = Literal[*types.split()], ...
        if keys or kind:
            name = f"{parameters.__name__}{section.title()}"
            made = section_of(parameters, keys=keys, about=about, name=name, **kind)
            made.__doc__ = (
                f"``[{section}]`` of blocks of type ``{types.replace(' ', '`` or ``')}``."
            )
            needed = any(key.is_required() for key in made.model_fields.values())
            result[section] = made, ... if needed else made()
    name = f"{parameters.__name__}Scene"
    scene = create_model(name, __base__=base, __doc__=parameters.__doc__, **result)
    scene.parameters = parameters
    return scene


class BlockSection(Section):
    """``[block]``: its type names the family."""

    type: str


class AssemblyScene(FamilyScene):
    """A scene of blocks that meet: what the rigid answer and load cases are for."""

    #: Scene class of each family by the type of its block.
    families: ClassVar[dict[str, type[AssemblyScene]]] = {}
    #: Whether fixed blocks are fixed at their outer faces; else they are rigid by default.
    stands: ClassVar[bool] = False

    block: BlockSection
    load: Any

    @classmethod
    def __pydantic_init_subclass__(cls, **options: Any) -> None:
        super().__pydantic_init_subclass__(**options)
        section: Any = cls.model_fields["block"].annotation
        for kind in get_args(section.model_fields["type"].annotation):
            cls.families[kind] = cls

    def build(self) -> Assembly:
        """Build the blocks."""
        raise NotImplementedError

    def build_load(self, assembly: Assembly) -> LoadCase:
        """Put the load on the blocks."""
        from geometry.loads import named_case, named_load

        load = self.load
        assert isinstance(load, TubeLoadSection)
        return named_case(
            assembly,
            load.case,
            load.pressure,
            as_printed=named_load(load.case).force_as_printed and load.as_printed,
            layer=load.layer,
        )

    def unmatched(self, assembly: Assembly) -> tuple[UnmatchedJoint, ...]:  # noqa: ARG002
        """Joints where facets do not match; most families match by construction or reject."""
        return ()

    @property
    def element_counts(self) -> dict[str, Any]:
        """Values of ``[mesh]`` that count elements; none where meshes are given block by block."""
        mesh = getattr(self, "mesh", None)
        if mesh is None:
            return {}
        return {k: v for k, v in mesh.model_dump().items() if not isinstance(v, float)}


class RoundScene(AssemblyScene):
    """A scene of blocks that stand round an axis, with inner and outer faces, in layers."""

    assembly: TubeAssemblySection
    mesh: Section
    load: TubeLoadSection

    @property
    def thickness(self) -> float:
        """Of the wall [mm]."""
        return float(self.block.thickness)  # type: ignore[attr-defined]

    def build_cell(self) -> Assembly:
        """Build the two layers that a long tube repeats, and their images."""
        raise NotImplementedError


def round_types() -> str:
    """Types of block that make tubes, in words."""
    result = [k for k, family in AssemblyScene.families.items() if issubclass(family, RoundScene)]
    return " or ".join(f'"{kind}"' for kind in sorted(result, reverse=True))
