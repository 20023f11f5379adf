"""Sections of contact: the law of all joints, gaps, and what joints of some blocks have."""

from __future__ import annotations

import math
from dataclasses import MISSING, fields
from typing import Annotated, Any, ClassVar, Literal, Self, cast

from pydantic import Field, create_model, model_validator

from fem.contact.law import LAWS, ContactLaw
from validation.scene.keys.docstrings import CLEARANCE, FRICTION, OF_LAWS, field_docstrings
from validation.scene.sections import Finite, NoAngle, NonNegative, Positive, Section


def _law_section() -> Any:
    """Section with the keys of all contact laws.

    None is the default where a law has no finite constant of its own.
    """
    keys: dict[str, Any] = {"law": (Literal[tuple(LAWS)], "exponential")}
    documented: dict[str, tuple[type, str]] = {}
    for law in LAWS.values():
        for constant in fields(law):
            own = constant.default is not MISSING and math.isfinite(constant.default)
            kind, default = (Positive, constant.default) if own else (Positive | None, None)
            key = law.keys.get(constant.name, constant.name)
            keys[key] = Annotated[kind, OF_LAWS[key]] if key in OF_LAWS else kind, Field(default)
            documented[key] = cast("type", law), constant.name
    made = create_model("_LawKeys", __base__=Section, **keys)
    made.documented_by = documented
    return made


_LawKeys: Any = _law_section()


def law_keys(name: str) -> tuple[str, ...]:
    """Keys of the constants of a law."""
    law = LAWS[name]
    return tuple(law.keys.get(constant.name, constant.name) for constant in fields(law))


class _LawSection(_LawKeys):  # type: ignore[misc]
    """A contact law: its name and its constants."""

    place: ClassVar[str] = "contact"
    """Of the keys, for messages."""

    @property
    def built(self) -> ContactLaw:
        """The law itself."""
        law = LAWS[self.law]
        given = {c.name: getattr(self, law.keys.get(c.name, c.name)) for c in fields(law)}
        return law(**{name: value for name, value in given.items() if value is not None})

    @property
    def words(self) -> str:
        """The law and its constants."""
        given = {key: getattr(self, key) for key in law_keys(self.law)}
        shown = [f"{k.replace('_', ' ')} {v:g}" for k, v in given.items() if v is not None]
        return f"{self.law} ({', '.join(shown)}; mm, MPa)"

    @model_validator(mode="after")
    def _constants_of_its_law(self) -> Self:
        """Reject constants that the law lacks, and those of another one."""
        for law in sorted(LAWS.values(), key=lambda law: law.name != self.law):
            for constant in fields(law):
                key = law.keys.get(constant.name, constant.name)
                field = type(self).model_fields[key]
                given = field.default is not None or getattr(self, key) is not None
                if law.name == self.law and not given and constant.default is MISSING:
                    about = field_docstrings(cast("type", law))[constant.name]
                    unit = about.rpartition(" ")[2].rstrip(".")
                    raise ValueError(
                        f'{self.place}.{key} is missing: the law "{law.name}" needs it {unit}'
                    )
                if law.name != self.law and given and field.default is None:
                    raise ValueError(
                        f'{self.place}.{key} belongs to law = "{law.name}"; remove one of the two'
                    )
        return self


class ContactPairSection(_LawSection):
    """``[[contact.pairs]]``: joints between some blocks with their own friction, law or both.

    Other joints have the friction of ``[effects.friction]`` and the law of ``[contact]``.
    """

    place: ClassVar[str] = "contact.pairs"

    between: tuple[Annotated[int, Field(ge=0)] | str, Annotated[int, Field(ge=0)] | str]
    """Two blocks, by number or name, or materials: of all joints between their blocks."""
    friction: Annotated[NonNegative | None, NoAngle, FRICTION] = None
    """Coefficient of friction μ [-]; 0: frictionless."""

    @property
    def has_law(self) -> bool:
        """Whether the pair has a law of its own."""
        return "law" in self.model_fields_set

    @model_validator(mode="after")
    def _friction_or_law(self) -> Self:
        """Reject a pair that states nothing, and constants of no law."""
        constants = self.model_fields_set - {"between", "friction", "law"}
        others = sorted(constants.difference(law_keys(self.law)))
        if others and self.has_law:
            raise ValueError(
                f"contact.pairs: got {', '.join(others)} beside law = {self.law!r}, which has "
                f"{', '.join(law_keys(self.law))}; remove one of the two"
            )
        if constants and not self.has_law:
            raise ValueError(
                f"contact.pairs: got {', '.join(sorted(constants))} without law; expected "
                f"law = {' or '.join(repr(name) for name in LAWS)} too"
            )
        if self.friction is None and not self.has_law:
            raise ValueError("contact.pairs: got a pair without friction and law; expected one")
        return self


class ContactSection(_LawSection):
    """``[contact]``: soft contact between blocks."""

    pairs: tuple[ContactPairSection, ...] = ()
    """Friction and contact law of some joints; rigid blocks have no law, methods and answers
    without friction ignore that."""

    clearance: Annotated[Finite, CLEARANCE] = 0.0
    """Gap along the normal of every facet before the load acts [mm]: blocks made too small by
    half of it. Negative: an interference fit, blocks made too large."""
    spacing: Annotated[NonNegative, CLEARANCE] = 0.0
    """Distance by which neighbouring blocks are moved apart before the load acts, their size kept
    [mm], as the paper's group did: inclined joints open by less or more. Both add up."""

    @property
    def frictionless_pairs(self) -> tuple[ContactPairSection, ...]:
        """Pairs with a law of their own, without their friction."""
        return tuple(
            pair.model_copy(update={"friction": None}) for pair in self.pairs if pair.has_law
        )

    @property
    def opened(self) -> bool:
        """Whether gaps are to be closed before blocks press on each other."""
        return self.clearance > 0.0 or self.spacing > 0.0

    @model_validator(mode="before")
    @classmethod
    def _which_gap(cls, data: Any) -> Any:
        """Reject the key that meant one gap to the solver and another one to a deck."""
        if isinstance(data, dict) and "initial_clearance" in data:
            value = data["initial_clearance"]
            raise ValueError(
                f"contact.initial_clearance: got {value!r}, which meant two things; write "
                f"contact.clearance = {value} (a gap along every normal, as runs took it) or "
                f"contact.spacing = {value} (blocks moved apart, as decks wrote it)"
            )
        return data


def gap_words(gaps: Any) -> str:
    """``clearance`` and ``spacing`` in words, to follow others; nothing where there are none."""
    given = ((name, getattr(gaps, name)) for name in ("clearance", "spacing"))
    return "".join(f", {name} {value:g} mm" for name, value in given if value)
