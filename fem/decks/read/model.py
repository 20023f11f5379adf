"""Materials, interactions, amplitudes and steps of a deck, in the meaning of its dialect."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, log

import numpy as np

from fem.contact.law import ContactLaw, ExponentialLaw, LinearPenalty
from fem.contact.own_law import TabularLaw
from fem.decks.read.cards import Card
from fem.decks.read.words import Dialect
from fem.element.material import Material
from fem.system.effects import BulkViscosity, Effects, RayleighDamping
from fem.system.rows import SmoothStepAmplitude
from geometry.mesh import FloatArray

#: Wave speed of materials without a density, which a static answer does not depend on [mm/s].
_WAVE_SPEED = 3.0e6
#: Hard contact of Abaqus as a penalty, in moduli of the first material per edge of a facet.
_HARD = 10.0
#: CalculiX' stick slope where none is stated, in moduli per length (frictions.f of its sources).
_STICK = 0.5
#: Points of CalculiX' exponential law as a table, from 1e-4 to 1e4 of its pressure at contact.
_POINTS = 400
_DECADES = 4.0


@dataclass
class Named:
    """A card with a name, and the cards that belong to it."""

    card: Card
    parts: dict[str, Card] = field(default_factory=dict)
    """By keyword."""


#: Cards that have names, and those that belong to the last of them.
_NAMED = ("MATERIAL", "SURFACE INTERACTION", "AMPLITUDE", "ORIENTATION")
_PARTS = {
    **dict.fromkeys(("ELASTIC", "DENSITY", "DAMPING"), "MATERIAL"),
    **dict.fromkeys(("SURFACE BEHAVIOR", "FRICTION"), "SURFACE INTERACTION"),
}


@dataclass
class ModelLines:
    """Model data beside meshes, by their names."""

    dialect: Dialect
    named: dict[str, dict[str, Named]] = field(default_factory=lambda: {w: {} for w in _NAMED})
    """By keyword and name."""
    other: list[Card] = field(default_factory=list)
    """Cards that are read where a problem is made: supports, contact."""
    notes: list[str] = field(default_factory=list)
    cap: float = inf
    """Stiffness cap of exponential laws that the heading of our decks keeps [MPa/mm]:
    Abaqus/Standard has no word for it."""

    @property
    def materials(self) -> dict[str, Named]:
        """Materials by name."""
        return self.named["MATERIAL"]

    @property
    def first_modulus(self) -> float:
        """Modulus of the first material [MPa]."""
        return material_of(next(iter(self.materials.values()))).young_modulus

    def note(self, text: str) -> None:
        """Keep a remark, once."""
        if text not in self.notes:
            self.notes.append(text)

    def add(self, card: Card) -> None:
        """Read a card of the model data."""
        word = card.keyword
        if word in self.named:
            name = card.parameter("NAME")
            if name in self.named[word]:
                raise card.wrong(f"{name} twice", "it once")
            self.named[word][name] = Named(card)
        elif word in _PARTS:
            known = self.named[_PARTS[word]]
            if not known:
                raise card.wrong("it first", f"it after *{_PARTS[word].title()}")
            next(reversed(known.values())).parts[word] = card
        else:
            self.other.append(card)

    def of(self, word: str, name: str, card: Card, line: int | None = None) -> Named:
        """What a card names.

        Raises
        ------
        DeckError
            When it is not defined.
        """
        if name not in self.named[word]:
            raise card.wrong(f"{word.lower()} {name or '(none)'}", "one that is defined", line)
        return self.named[word][name]


def material_of(stated: Named) -> Material:
    """Material of its lines.

    Raises
    ------
    DeckError, MaterialError
        Without isotropic elasticity, or with constants that no solid has.
    """
    elastic, density = stated.parts.get("ELASTIC"), stated.parts.get("DENSITY")
    if elastic is None:
        raise stated.card.wrong("no *Elastic", "one")
    kind, values = elastic.option("TYPE") or "ISO", elastic.numbers()
    if kind not in {"ISO", "ISOTROPIC"} or len(elastic.data) > 1 or len(values) not in {2, 3}:
        raise elastic.unread(f"type={kind} of {len(values)} numbers")
    modulus, ratio = values[:2].tolist()
    own = [modulus / _WAVE_SPEED**2] if density is None else density.numbers().tolist()
    if density is not None and len(own) not in {1, 2}:
        raise density.unread(f"of {len(own)} numbers")
    return Material(density=own[0], young_modulus=modulus, poisson_ratio=ratio)


# ---------------------------------------------------------------------------------------------
# Contact


def law_of(model: ModelLines, stated: Named, size: float) -> ContactLaw:
    """Law of a surface interaction.

    Parameters
    ----------
    model
        Its dialect says what the words mean.
    stated
        The interaction.
    size
        Edge of a facet in contact, for hard contact [mm].

    Raises
    ------
    DeckError, ContactLawError
        Naming the line.
    """
    card, abaqus = stated.parts.get("SURFACE BEHAVIOR", stated.card), model.dialect == "abaqus"
    kind = card.option("PRESSURE-OVERCLOSURE") or "HARD"
    values = [] if kind == "HARD" else card.numbers().tolist()
    if kind == "HARD" and abaqus:
        stiffness = _HARD * model.first_modulus / size
        model.note(f"contact: hard contact is a penalty of {stiffness:.4g} MPa/mm (10 E per edge)")
        return LinearPenalty(stiffness)
    if kind == "LINEAR" and values:
        return LinearPenalty(values[0])
    if kind == "EXPONENTIAL" and abaqus and len(values) >= 2:
        return ExponentialLaw(values[0], values[1], values[2] if len(values) > 2 else model.cap)
    if kind == "EXPONENTIAL" and len(values) == 2 and min(values) > 0.0:
        model.note("contact: CalculiX' law p0 exp(ln(100) d/c0) is a table of 400 points")
        decades = np.linspace(-_DECADES, _DECADES, _POINTS)
        overclosure = values[0] / log(100.0) * log(10.0) * decades
        pressure = values[1] * 10.0**decades * (decades > -_DECADES)
        return TabularLaw(np.column_stack([overclosure, pressure]))
    if kind == "TABULAR" and len(values) >= 4 and len(values) % 2 == 0:
        return TabularLaw(np.reshape(values, (-1, 2))[:, ::-1])
    raise card.unread(f"pressure-overclosure={kind} of {len(values)} numbers")


def friction_of(model: ModelLines, stated: Named) -> tuple[float, float | None]:
    """Coefficient, and stick slope [MPa/mm] where the deck states one; 0: frictionless."""
    card, abaqus = stated.parts.get("FRICTION"), model.dialect == "abaqus"
    if card is None:
        return 0.0, None
    values = card.numbers().tolist()
    if len(card.data) != 1 or not 1 <= len(values) <= (1 if abaqus else 2):
        raise card.unread(f"with {len(values)} numbers")
    if abaqus:
        slope = card.parameters.get("SHEAR TRACTION SLOPE")
        return values[0], None if slope is None else card.number(card.line, slope)
    if values[1:] and values[1] > 0.0:
        return values[0], values[1]
    model.note("contact: no stick slope; CalculiX takes half of the modulus per length")
    return values[0], _STICK * model.first_modulus


# ---------------------------------------------------------------------------------------------
# Steps


@dataclass
class Step:
    """One step of a deck."""

    card: Card
    cards: list[Card] = field(default_factory=list)
    follows_large: bool = False
    """Whether a step before takes forces in the deformed position; then this one does too."""

    @property
    def large_rotations(self) -> bool:
        """Whether forces are taken in the deformed position; explicit steps do by default."""
        if self.follows_large or "NLGEOM" not in self.card.parameters:
            return self.follows_large or self.explicit
        return self.card.option("NLGEOM") != "NO"

    @property
    def turns(self) -> bool:
        """Whether blocks turn by any angle: in explicit steps alone."""
        return self.explicit and self.large_rotations

    @property
    def procedure(self) -> Card:
        """Card ``*Static`` or ``*Dynamic``."""
        result = [card for card in self.cards if card.keyword in {"STATIC", "DYNAMIC"}]
        if len(result) != 1:
            raise self.card.wrong(f"{len(result)} procedures", "*Static or *Dynamic, explicit")
        return result[0]

    @property
    def explicit(self) -> bool:
        """Whether it is a step of explicit dynamics.

        Raises
        ------
        DeckError
            Implicit dynamics.
        """
        card = self.procedure
        if card.keyword == "DYNAMIC" and "EXPLICIT" not in card.parameters:
            raise card.unread("implicit")
        return card.keyword == "DYNAMIC"

    @property
    def times(self) -> list[str]:
        """Entries of the procedure: first increment, duration, least and largest increment."""
        return [*next(iter(self.procedure.rows()), (0, []))[1], "", "", "", ""][:4]

    @property
    def duration(self) -> float:
        """Length of the step [s], 1 where it states none."""
        card, text = self.procedure, self.times[1]
        value = card.number(card.data_line[0], text) if text else 1.0
        if value <= 0.0:
            raise card.wrong(f"a step of {value:g} s", "a positive time")
        return value


def damping_of_step(model: ModelLines, step: Step) -> Effects:
    """Damping of an explicit step."""
    dampings = {_damping(material) for material in model.materials.values()}
    if len(dampings) > 1:
        raise step.card.unread("with materials of several *Damping")
    bulk = [card for card in step.cards if card.keyword == "BULK VISCOSITY"]
    # CalculiX has no bulk viscosity.
    viscosity = BulkViscosity() if model.dialect is Dialect.ABAQUS else None
    if bulk:
        values = bulk[-1].numbers()[:2].tolist()
        viscosity = BulkViscosity(*values) if any(values) else None
    return Effects(rayleigh=next(iter(dampings)), bulk_viscosity=viscosity)


def _damping(material: Named) -> RayleighDamping | None:
    card = material.parts.get("DAMPING")
    if card is None:
        return None
    given = {w: card.number(card.line, text) for w, text in card.parameters.items()}
    return RayleighDamping(given.get("ALPHA"), given.get("BETA"))


def _amplitude(model: ModelLines, card: Card) -> tuple[Card, str, FloatArray] | None:
    """Amplitude that a card names, its definition, and its times and values, (n, 2)."""
    name = card.option("AMPLITUDE")
    if not name:
        return None
    stated = model.of("AMPLITUDE", name, card).card
    kind = stated.option("DEFINITION") or "TABULAR"
    if kind != "TABULAR" and (kind != "SMOOTH STEP" or model.dialect is not Dialect.ABAQUS):
        raise stated.unread(f"definition={kind}")
    values = stated.numbers()
    table = values.reshape(-1, 2) if len(values) % 2 == 0 else np.zeros((0, 2))
    if len(table) < 2 or (np.diff(table[:, 0]) <= 0.0).any():
        raise stated.wrong(f"{len(values)} numbers", "pairs of rising times and shares")
    return stated, kind, table


def path_of(model: ModelLines, card: Card) -> FloatArray | None:
    """Times and values of the amplitude that a card names, (n, 2); None: it names none.

    Raises
    ------
    DeckError
        An amplitude that is not defined, or of another kind than a table or a smooth step.
    """
    amplitude = _amplitude(model, card)
    return None if amplitude is None else amplitude[2]


def turning_times(path: FloatArray) -> FloatArray:
    """Times at which an amplitude, (n, 2), turns from rising to falling or back, (n_turns,)."""
    way = np.sign(np.diff(path[:, 1]))
    moving = np.flatnonzero(way)
    return np.asarray(path[moving[np.flatnonzero(np.diff(way[moving]))] + 1, 0])


#: A table of so many points that differs from a smooth step by less at each is one, as our decks
#: for CalculiX have it.
_SAMPLES, _SAMPLED = 50, 1e-9


def smooth_time(model: ModelLines, card: Card) -> float | None:
    """Length of the smooth step by which what a card states grows [s]; None: it names no step.

    Raises
    ------
    DeckError
        Loads of an explicit step with a table; and as `path_of`.
    """
    amplitude = _amplitude(model, card)
    if amplitude is None:
        return None
    stated, kind, table = amplitude
    end = float(table[-1, 0])
    enough = len(table) == 2 if kind == "SMOOTH STEP" else len(table) >= _SAMPLES
    smooth = SmoothStepAmplitude(end) if end > 0.0 and enough else None
    if smooth and np.abs([smooth(time) for time in table[:, 0]] - table[:, 1]).max() < _SAMPLED:
        return end
    if card.keyword == "BOUNDARY" and kind == "TABULAR":
        return None
    raise stated.unread("of loads of an explicit step, but a smooth step from 0 at time 0 to 1,")
