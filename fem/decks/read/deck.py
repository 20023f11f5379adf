"""Read input decks of Abaqus and CalculiX, and state the problem that they describe."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from math import inf
from pathlib import Path

from fem.decks.deck import Flavour
from fem.decks.keywords import DeckError
from fem.decks.read.cards import Card, deck_text, read_cards
from fem.decks.read.mesh import Instance, Part, Places, add_elements, add_nodes, add_set, placed
from fem.decks.read.model import ModelLines, Step, add_model, effects_of
from fem.decks.read.problem import Built, build_problem
from fem.decks.read.words import Dialect, check_words, dialect_of, spelt
from fem.method import Explicit, Static
from fem.problem import Problem
from geometry.errors import RefusedError, unreadable


@dataclass
class InputDeck:
    """An input deck of Abaqus or CalculiX.

    ``solve_static(read_deck("case.inp").problem())`` is its static state.
    """

    name: str
    """Of its file."""
    dialect: Dialect
    """Program whose meaning its keywords have."""
    detected: str
    """What says so."""
    places: Places
    """Parts at their places, with sets and surfaces."""
    model: ModelLines
    """Materials, interactions and the like."""
    steps: tuple[Step, ...]
    """Its steps."""
    without_influence: tuple[str, ...] = ()
    """Keywords and parameters that change nothing in the answer."""

    @cached_property
    def built(self) -> Built:
        """Blocks, contact, supports and loads as a problem.

        Raises
        ------
        RefusedError
            Naming the line of what is not covered.
        """
        return build_problem(self.name, self.places, self.model, self.steps)

    def problem(self) -> Problem:
        """State the problem: blocks, material, contact, supports and loads.

        Raises
        ------
        DeckError
            What is not covered, by its line.
        ProblemError, AssemblyError, MeshError, MaterialError, ContactLawError
            Blocks, units and constants that no solver takes.
        """
        return self.built.problem

    def validate(self) -> tuple[str, ...]:
        """Check everything that a solution checks before it begins.

        Returns
        -------
        tuple[str, ...]
            Remarks: where the answer differs from that of the other program.

        Raises
        ------
        RefusedError
            As `problem`.
        """
        problem = self.problem()
        if problem.load_case.fixed.all():
            raise DeckError(f"{self.name}: every block is fixed; expected one that deforms")
        _ = problem.deformable
        return tuple(self.model.notes)

    @property
    def flavour(self) -> Flavour:
        """Flavour in which its problem is written for its program."""
        if self.dialect is Dialect.CALCULIX:
            return Flavour.CALCULIX
        return Flavour.GENERAL if self.steps[-1].explicit else Flavour.STANDARD

    @property
    def method(self) -> Static | Explicit:
        """How its last step is solved: on its own mesh.

        Forces on nodes belong to that mesh, and have no error bars.
        """
        if not self.steps[-1].explicit:
            of_mesh = bool(self.problem().load_case.nodes)
            return Static(mesh="scene", error_estimate=not of_mesh)
        effects = effects_of(self.model, self.steps[0])
        return Explicit(
            damping="none",
            rayleigh=effects.rayleigh,
            bulk_viscosity=effects.bulk_viscosity,
            ramp_time=self.built.ramp_time or 0.0,
            end_time=self.steps[-1].duration,
            error_estimate=False,
        )


def read_deck(path: str | Path, *, dialect: str | None = None) -> InputDeck:
    """Read an input deck of Abaqus or CalculiX.

    Parameters
    ----------
    path
        The file; those that it includes are beside it.
    dialect
        ``abaqus`` or ``calculix``; None: what its keywords are.

    Returns
    -------
    InputDeck
        Its parts, sets, materials and steps; ``problem()`` states the problem.

    Raises
    ------
    DeckError
        No file, or the line of a keyword, parameter or value that is not covered.
    """
    path = Path(path)
    why = unreadable(path)
    if why is not None:
        raise DeckError(f"{path}: {why}; expected a deck")
    if dialect is not None and dialect not in set(Dialect):
        raise DeckError(f"dialect: got {dialect!r}; expected {' or '.join(Dialect)}")
    try:
        stated = None if dialect is None else Dialect(dialect)
        return deck_of_lines(deck_text(path), name=path.stem, folder=path.parent, dialect=stated)
    except RefusedError as error:
        raise type(error)(f"{path}: {error}") from None


def deck_of_lines(
    lines: Iterable[str],
    *,
    name: str = "deck",
    folder: Path | None = None,
    dialect: Dialect | None = None,
) -> InputDeck:
    """Read the lines of a deck: see `read_deck`."""
    cards = [spelt(card) for card in read_cards(lines, folder)]
    without = check_words(cards)
    if not cards:
        raise DeckError("line 1: the file is empty; expected a deck")
    kind, detected = dialect_of(cards, dialect)
    reader = _Reader(ModelLines(kind))
    reader.places.each_once = kind is Dialect.CALCULIX
    for card in cards:
        reader.read(card)
    heading = next((card for card in cards if card.keyword == "HEADING"), cards[0])
    reader.model.cap = _cap(heading)
    places = reader.finished(cards[-1])
    steps = tuple(reader.steps)
    return InputDeck(name, kind, detected, places, reader.model, steps, without)


def _cap(heading: Card) -> float:
    """Stiffness cap in the heading of a deck that this package wrote; else none."""
    for line, text in zip(heading.data_line, heading.data, strict=True):
        key, _, value = text.partition(": ")
        if key == "maximum contact stiffness" and value != "none":
            return heading.number(line, value)
    return inf


#: Keywords of meshes, and what reads them.
_MESH = {"NODE", "ELEMENT", "NSET", "ELSET", "SURFACE", "SOLID SECTION"}
#: Model data that may stand in a step too.
_NAMED = {"SURFACE INTERACTION", "SURFACE BEHAVIOR", "FRICTION", "AMPLITUDE"}


@dataclass
class _Reader:
    """Where in a deck a card stands: in a part, an instance, the assembly, a step."""

    model: ModelLines
    parts: dict[str, Part] = field(default_factory=dict)
    flat: Part = field(default_factory=lambda: Part(""))
    part: Part | None = None
    places: Places = field(default_factory=lambda: Places([]))
    open: list[Card] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)

    @property
    def inside(self) -> str:
        """Keyword of what is open."""
        return self.open[-1].keyword if self.open else ""

    def read(self, card: Card) -> None:
        """Read one card."""
        word = card.keyword
        if word.startswith("END "):
            self._end(card)
        elif word in {"PART", "ASSEMBLY", "INSTANCE", "STEP"}:
            self._begin(card)
        elif self.inside == "STEP":
            self._in_step(card)
        elif word == "SPRING" or (word == "ELEMENT" and card.option("TYPE") == "SPRING1"):
            if self.inside in {"PART", "INSTANCE"}:
                raise DeckError(
                    f"{card.at()}: springs of a part are not covered; expected them in *Assembly"
                )
            self.model.other.append(card)
        elif word in _MESH:
            self._mesh(card)
        elif self.inside in {"PART", "INSTANCE"}:
            raise DeckError(
                f"{card.at()}: {card.title} stands in {self.open[-1].title}; expected it in the "
                "model data"
            )
        else:
            add_model(self.model, card)

    def _in_step(self, card: Card) -> None:
        if card.keyword in _MESH | {"SPRING", "TRANSFORM"}:
            raise DeckError(f"{card.at()}: {card.title} stands in a step; expected it before")
        if card.keyword in _NAMED:
            add_model(self.model, card)
        else:
            self.steps[-1].cards.append(card)

    def _begin(self, card: Card) -> None:
        word = card.keyword
        outer = {"PART": "", "ASSEMBLY": "", "INSTANCE": "ASSEMBLY", "STEP": ""}[word]
        if self.inside != outer:
            raise DeckError(
                f"{card.at()}: {card.title} stands in {self.open[-1].title if self.open else 'no'}"
                f"{'' if self.open else ' *Assembly'}; expected it "
                + ("in *Assembly" if outer else "after its end")
            )
        self.open.append(card)
        if word == "PART":
            name = card.parameter("NAME")
            if name in self.parts:
                raise DeckError(f"{card.at()}: *Part {name} is there twice; expected it once")
            self.part = self.parts[name] = Part(name)
        elif word == "STEP":
            large = any("NLGEOM" in s.card.parameters and s.large_rotations for s in self.steps)
            self.steps.append(Step(card, follows_large=large))
        elif word == "INSTANCE":
            self._instance(card)

    def _instance(self, card: Card) -> None:
        part, name = card.parameter("PART"), card.parameter("NAME")
        if part not in self.parts or name in self.places.by_name:
            raise DeckError(
                f"{card.at()}: got instance {name} of part {part}; expected a name of its own and "
                f"one of {', '.join(self.parts) or 'the parts, of which there is none'}"
            )
        self.places.by_name[name] = len(self.places.instances)
        self.places.instances.append(placed(card, self.parts[part]))

    def _end(self, card: Card) -> None:
        if card.keyword != f"END {self.inside}":
            raise DeckError(f"{card.at()}: {card.title} ends nothing; expected it after its begin")
        self.open.pop()
        self.part = None

    def _mesh(self, card: Card) -> None:
        if self.inside == "INSTANCE":
            raise DeckError(
                f"{card.at()}: {card.title} stands in an instance; expected meshes in parts"
            )
        assembled = bool(self.parts) and self.part is None
        if assembled and card.keyword in {"NSET", "ELSET"}:
            self.places.add_set(card)
        elif assembled and card.keyword == "SURFACE":
            self.places.surfaces[card.parameter("NAME")] = card
        elif assembled:
            raise DeckError(
                f"{card.at()}: {card.title} of the assembly is not covered; expected it in a part"
            )
        else:
            self._in_part(self.flat if self.part is None else self.part, card)

    def _in_part(self, part: Part, card: Card) -> None:
        word = card.keyword
        if word == "NODE":
            add_nodes(part, card)
        elif word == "ELEMENT":
            add_elements(part, card)
        elif word == "SURFACE":
            part.surfaces[card.parameter("NAME")] = card
        elif word == "SOLID SECTION":
            part.sections.append(card)
        else:
            add_set(part, card)

    def finished(self, last: Card) -> Places:
        """All parts at their places.

        Raises
        ------
        DeckError
            A file that ends early, or without a step.
        """
        end = last.data_line[-1] if last.data_line else last.line
        if self.open:
            begun = self.open[-1]
            raise DeckError(
                f"{last.at(end)}: the file ends inside {begun.title} ({begun.at()}); expected *End "
                f"{begun.keyword.title()}: the file is truncated"
            )
        if not self.steps:
            raise DeckError(f"{last.at(end)}: the file ends without a *Step; expected one")
        if not self.parts:
            import numpy as np

            self.places.instances.append(Instance("", self.flat, np.eye(3), np.zeros(3)))
            self.places.by_name[""] = 0
        return self.places
