"""Materials, interactions, amplitudes and steps of a deck, in the meaning of its dialect."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, log
from typing import Any, TypeVar

import numpy as np

from fem.contact.law import ContactLaw, ExponentialLaw, LinearPenalty
from fem.contact.own_law import TabularLaw
from fem.decks.keywords import DeckError
from fem.decks.read.cards import Card
from fem.decks.read.words import Dialect
from fem.element.material import Material
from fem.system.effects import BulkViscosity, Effects, RayleighDamping
from fem.system.forces import SmoothStepAmplitude
from geometry.mesh import FloatArray

_Stated = TypeVar("_Stated")
#: Wave speed of materials without a density, which a static answer does not depend on [mm/s].
_WAVE_SPEED = 3.0e6
#: CalculiX' penalty of hard contact, in moduli of the first material per length, and its stick
#: slope where none is stated (surfacebehaviors.f and frictions.f of its sources).
_HARD, _STICK = 50.0, 0.5
#: Points of CalculiX' exponential law as a table, from 1e-4 to 1e4 of its pressure at contact.
_POINTS = 400
_DECADES = 4.0


@dataclass
class MaterialLines:
    """What a deck states of a material."""

    card: Card
    elastic: tuple[float, float] | None = None
    density: float | None = None
    damping: RayleighDamping | None = None

    def built(self) -> Material:
        """The material.

        Raises
        ------
        DeckError, MaterialError
            Without elasticity, or with constants that no solid has.
        """
        if self.elastic is None:
            raise DeckError(f"{self.card.at()}: the material has no *Elastic; expected one")
        modulus, ratio = self.elastic
        density = modulus / _WAVE_SPEED**2 if self.density is None else self.density
        return Material(density=density, young_modulus=modulus, poisson_ratio=ratio)


@dataclass
class Interaction:
    """What a deck states of a surface interaction."""

    card: Card
    behavior: Card | None = None
    friction: Card | None = None


@dataclass
class ModelLines:
    """Model data beside meshes, by their names."""

    dialect: Dialect
    materials: dict[str, MaterialLines] = field(default_factory=dict)
    interactions: dict[str, Interaction] = field(default_factory=dict)
    amplitudes: dict[str, Card] = field(default_factory=dict)
    orientations: dict[str, Card] = field(default_factory=dict)
    total_time: list[Card] = field(default_factory=list)
    """Amplitudes in total time, which is that of the step where there is one step."""
    other: list[Card] = field(default_factory=list)
    """Cards that are read where a problem is made: supports, contact, motions."""
    notes: list[str] = field(default_factory=list)
    cap: float = inf
    """Stiffness cap of exponential laws that the heading of our decks keeps [MPa/mm]:
    Abaqus/Standard has no word for it."""

    def note(self, text: str) -> None:
        """Keep a remark, once."""
        if text not in self.notes:
            self.notes.append(text)


#: Keywords of a material, which follow *Material.
OF_MATERIAL = {"ELASTIC", "DENSITY", "DAMPING"}


def add_model(model: ModelLines, card: Card) -> None:
    """Read a card of the model data."""
    word = card.keyword
    if word == "MATERIAL":
        model.materials[_new(card, model.materials)] = MaterialLines(card)
    elif word in OF_MATERIAL:
        _of_material(card, _last(card, model.materials, "*Material"))
    elif word == "SURFACE INTERACTION":
        model.interactions[_new(card, model.interactions)] = Interaction(card)
    elif word == "SURFACE BEHAVIOR":
        _last(card, model.interactions, "*Surface Interaction").behavior = card
    elif word == "FRICTION":
        _last(card, model.interactions, "*Surface Interaction").friction = card
    elif word == "AMPLITUDE":
        model.amplitudes[_new(card, model.amplitudes)] = card
    elif word == "ORIENTATION":
        model.orientations[_new(card, model.orientations)] = card
    else:
        model.other.append(card)


def _new(card: Card, known: dict[str, Any]) -> str:
    name = card.parameter("NAME")
    if name in known:
        raise DeckError(f"{card.at()}: {card.title} {name} is there twice; expected it once")
    return name


def _last(card: Card, known: dict[str, _Stated], after: str) -> _Stated:
    if not known:
        raise DeckError(f"{card.at()}: {card.title} stands before any {after}; expected it after")
    return next(reversed(known.values()))


def _of_material(card: Card, material: MaterialLines) -> None:
    values = [float(value) for value in card.numbers()]
    if card.keyword == "DAMPING":
        given = {
            key: card.number(card.line, card.parameters[word])
            for word, key in (("ALPHA", "mass_proportional"), ("BETA", "stiffness_proportional"))
            if word in card.parameters
        }
        material.damping = RayleighDamping(**given)
    elif card.keyword == "DENSITY":
        if len(values) not in {1, 2}:
            raise DeckError(f"{card.at()}: *Density has {len(values)} numbers; expected one")
        material.density = values[0]
    else:
        kind = card.option("TYPE") or "ISO"
        if kind not in {"ISO", "ISOTROPIC"} or len(card.data) > 1 or len(values) not in {2, 3}:
            raise DeckError(
                f"{card.at()}: *Elastic of type {kind} with {len(values)} numbers in "
                f"{len(card.data)} lines; expected a modulus and a ratio, isotropic and the same "
                "at every temperature"
            )
        material.elastic = values[0], values[1]


# ---------------------------------------------------------------------------------------------
# Contact


def law_of(model: ModelLines, stated: Interaction, size: float) -> ContactLaw:
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
    card = stated.behavior
    kind = "HARD" if card is None else card.option("PRESSURE-OVERCLOSURE") or "HARD"
    values = [] if card is None or kind == "HARD" else [float(v) for v in card.numbers()]
    where = stated.card if card is None else card
    if model.dialect is Dialect.CALCULIX and (
        card is None or "PRESSURE-OVERCLOSURE" not in card.parameters
    ):
        raise DeckError(
            f"{where.at()}: no pressure-overclosure, which CalculiX requires; expected "
            "HARD, LINEAR, EXPONENTIAL or TABULAR under *Surface Behavior"
        )
    if kind == "HARD" or (kind == "LINEAR" and not values and model.dialect is Dialect.CALCULIX):
        return _hard(model, size)
    if kind == "LINEAR" and values:
        return LinearPenalty(values[0])
    if kind == "EXPONENTIAL" and len(values) >= 2:
        return _exponential(model, values)
    if kind in {"TABULAR", "TABULATED"} and card is not None:
        return _table(card)
    raise DeckError(
        f"{where.at()}: got pressure-overclosure={kind} with {len(values)} numbers; expected HARD, "
        "LINEAR with 1, EXPONENTIAL with 2 or 3, or TABULAR"
    )


def _hard(model: ModelLines, size: float) -> ContactLaw:
    first = next(iter(model.materials.values())).built().young_modulus
    stiffness = _HARD * first if model.dialect is Dialect.CALCULIX else 10.0 * first / size
    model.note(
        f"contact: hard contact is a penalty of {stiffness:.4g} MPa/mm "
        + (
            "(50 E per length, CalculiX' default)"
            if model.dialect is Dialect.CALCULIX
            else "(10 E per edge of a facet)"
        )
    )
    return LinearPenalty(stiffness)


def _exponential(model: ModelLines, values: list[float]) -> ContactLaw:
    c0, p0 = values[:2]
    if model.dialect is Dialect.ABAQUS:
        return ExponentialLaw(c0, p0, values[2] if len(values) > 2 else model.cap)
    if not (c0 > 0.0 and p0 > 0.0):
        return ExponentialLaw(c0, p0)  # rejects the constant by its name
    model.note("contact: CalculiX' exponential law, p0 exp(ln(100) d/c0), as a table of 400 points")
    decades = np.linspace(-_DECADES, _DECADES, _POINTS)
    overclosure = c0 / log(100.0) * log(10.0) * decades
    pressure = p0 * 10.0**decades
    pressure[0] = 0.0
    return TabularLaw(np.column_stack([overclosure, pressure]))


def _table(card: Card) -> ContactLaw:
    values = card.numbers()
    if len(values) % 2 or len(values) < 4:
        raise DeckError(
            f"{card.at()}: got {len(values)} numbers in a table; expected pairs of a pressure and "
            "an overclosure"
        )
    return TabularLaw(values.reshape(-1, 2)[:, ::-1])


def friction_of(model: ModelLines, stated: Interaction) -> tuple[float, float | None]:
    """Coefficient, and stick slope [MPa/mm] where the deck states one; 0: frictionless."""
    card = stated.friction
    if card is None:
        return 0.0, None
    rows = list(card.rows())
    values = [] if len(rows) != 1 else [card.number(rows[0][0], t) for t in rows[0][1] if t]
    if not values or (model.dialect is Dialect.ABAQUS and len(values) > 1):
        raise DeckError(
            f"{card.at()}: *Friction has {len(rows)} lines; expected one with a coefficient"
            + (" alone" if model.dialect is Dialect.ABAQUS else " and a stick slope")
        )
    if model.dialect is Dialect.ABAQUS:
        slope = card.parameters.get("SHEAR TRACTION SLOPE")
        return values[0], None if slope is None else card.number(card.line, slope)
    if len(values) > 1 and values[1] > 0.0:
        return values[0], values[1]
    modulus = next(iter(model.materials.values())).built().young_modulus
    model.note("contact: no stick slope; CalculiX takes half of the modulus per length")
    return values[0], _STICK * modulus


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
        if self.follows_large:
            return True
        stated = self.card.option("NLGEOM")
        if "NLGEOM" in self.card.parameters:
            return stated != "NO"
        return self.explicit

    @property
    def procedure(self) -> Card:
        """Card *Static or *Dynamic."""
        result = [card for card in self.cards if card.keyword in {"STATIC", "DYNAMIC"}]
        if len(result) != 1:
            raise DeckError(
                f"{self.card.at()}: the step has {len(result)} procedures; expected *Static or "
                "*Dynamic, explicit"
            )
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
            raise DeckError(
                f"{card.at()}: implicit dynamics is not covered; expected *Static, or *Dynamic, "
                "explicit"
            )
        return card.keyword == "DYNAMIC"

    @property
    def duration(self) -> float:
        """Length of the step [s], 1 where it states none."""
        rows = list(self.procedure.rows())
        row = rows[0][1] if rows else []
        text = row[1] if len(row) > 1 else ""
        value = self.procedure.number(rows[0][0], text) if text else 1.0
        if value <= 0.0:
            raise DeckError(
                f"{self.procedure.at()}: the step lasts {value:g}; expected a positive time"
            )
        return value


def effects_of(model: ModelLines, step: Step) -> Effects:
    """Damping of an explicit step."""
    dampings = {material.damping for material in model.materials.values()}
    if len(dampings) > 1:
        card = next(iter(model.materials.values())).card
        raise DeckError(f"{card.at()}: materials have several *Damping; expected the same in all")
    bulk = [card for card in step.cards if card.keyword == "BULK VISCOSITY"]
    abaqus = model.dialect is Dialect.ABAQUS  # CalculiX has no bulk viscosity
    viscosity = BulkViscosity() if abaqus else None
    if bulk:
        values = [float(v) for v in bulk[-1].numbers()]
        viscosity = BulkViscosity(*values[:2]) if any(values) else None
    return Effects(rayleigh=next(iter(dampings), None), bulk_viscosity=viscosity)


def _amplitude(model: ModelLines, card: Card) -> tuple[Card, str, FloatArray] | None:
    """Amplitude that a card names, its definition, and its times and values, (n, 2)."""
    name = card.option("AMPLITUDE")
    if not name:
        return None
    if name not in model.amplitudes:
        raise DeckError(
            f"{card.at()}: got amplitude {name}; expected one of "
            f"{', '.join(model.amplitudes) or 'those of *Amplitude, of which there is none'}"
        )
    stated = model.amplitudes[name]
    kind = stated.option("DEFINITION") or "TABULAR"
    values = stated.numbers()
    if kind == "SMOOTH STEP" and model.dialect is not Dialect.ABAQUS:
        kind = "TABULAR"
        model.note("amplitude: CalculiX reads a smooth step as straight lines")
    elif kind == "EQUALLY SPACED" and "FIXED INTERVAL" in stated.parameters:
        kind, values = "TABULAR", _spaced(stated, values)
    elif kind not in {"TABULAR", "SMOOTH STEP"} or stated.option("VALUE") not in {"", "RELATIVE"}:
        raise DeckError(
            f"{stated.at()}: got an amplitude of definition {kind}, value "
            f"{stated.option('VALUE') or 'RELATIVE'}; expected a relative table or a smooth step"
        )
    if stated.option("TIME") not in {"", "STEP TIME"}:
        model.total_time.append(stated)
    table = values.reshape(-1, 2) if len(values) % 2 == 0 and len(values) else np.zeros((0, 2))
    if len(table) < 2 or (np.diff(table[:, 0]) <= 0.0).any():
        raise DeckError(
            f"{stated.at()}: got {len(values)} numbers; expected two pairs or more of a time and a "
            "share, at rising times"
        )
    return stated, kind, table


def _spaced(card: Card, values: FloatArray) -> FloatArray:
    """Times and values of an amplitude at equal intervals, one after the other."""
    interval = card.number(card.line, card.parameters["FIXED INTERVAL"])
    begin = card.number(card.line, card.parameters.get("BEGIN", "0."))
    times = begin + interval * np.arange(len(values))
    return np.asarray(np.column_stack([times, values]).ravel())


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


#: Table that differs from a smooth step by less at its points is one, as our decks for CalculiX.
_SAMPLED = 1e-9


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
    if kind == "SMOOTH STEP" and np.array_equal(table[[0, 0, 1], [0, 1, 1]], (0, 0, 1)):
        return float(table[1, 0])
    smooth = SmoothStepAmplitude(float(table[-1, 0])) if table[-1, 0] > 0.0 else None
    if smooth and np.abs([smooth(time) for time in table[:, 0]] - table[:, 1]).max() < _SAMPLED:
        return float(table[-1, 0])
    if card.keyword == "BOUNDARY" and kind == "TABULAR":
        return None
    raise DeckError(
        f"{stated.at()}: explicit runs have a smooth step from 0 at time 0 to 1 as amplitude of "
        "loads; expected definition=SMOOTH STEP and 0., 0., T, 1."
    )
