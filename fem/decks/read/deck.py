"""Read input decks of Abaqus and CalculiX, and state the problem that they describe."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from math import inf
from pathlib import Path

from fem.decks.deck import Flavour
from fem.decks.keywords import DeckError
from fem.decks.read.blocks import Blocks, placed
from fem.decks.read.cards import Card, deck_text, read_cards
from fem.decks.read.mesh import DeckPart, add_elements, add_nodes, add_set
from fem.decks.read.model import ModelLines, Step, damping_of_step
from fem.decks.read.problem import build_problem
from fem.decks.read.words import Dialect, check_words, dialect_of, spelt
from fem.method import Explicit, Static
from fem.problem import Problem
from geometry.errors import RefusedError


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
    blocks: Blocks
    """Parts at their places, with sets and surfaces."""
    model: ModelLines
    """Materials, interactions and the like."""
    steps: tuple[Step, ...]
    """Its steps."""
    without_influence: tuple[str, ...] = ()
    """Keywords and parameters that change nothing in the answer."""

    @cached_property
    def _built(self) -> tuple[Problem, float | None]:
        return build_problem(self.name, self.blocks, self.model, self.steps)

    def problem(self) -> Problem:
        """State the problem: blocks, material, contact, supports and loads.

        Raises
        ------
        DeckError
            What is not covered, by its line.
        ProblemError, AssemblyError, MeshError, MaterialError, ContactLawError
            Blocks, units and constants that no solver takes.
        """
        return self._built[0]

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
        _ = problem.system
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
            return Static(mesh="scene", error_estimate=not self.problem().load_case.nodes)
        effects = damping_of_step(self.model, self.steps[0])
        return Explicit(
            damping="none",
            rayleigh=effects.rayleigh,
            bulk_viscosity=effects.bulk_viscosity,
            ramp_time=self._built[1] or 0.0,
            end_time=self.steps[-1].duration,
        )


def read_deck(path: str | Path, *, dialect: str | None = None) -> InputDeck:
    """Read an input deck of Abaqus or CalculiX.

    Parameters
    ----------
    path
        The file; those that it includes are in its folder or below.
    dialect
        ``abaqus`` or ``calculix``; None: what its keywords are.

    Returns
    -------
    InputDeck
        Its parts, sets, materials and steps; ``problem()`` states the problem.

    Raises
    ------
    DeckError
        No file, or the line of a keyword, parameter or value that is not read.
    """
    path = Path(path)
    if dialect is not None and dialect not in set(Dialect):
        raise DeckError(f"dialect: got {dialect!r}; expected {' or '.join(Dialect)}")
    lines, stated = deck_text(path), None if dialect is None else Dialect(dialect)
    try:
        return deck_of_lines(lines, name=path.stem, folder=path.parent, dialect=stated)
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
    reader.blocks.each_once = kind is Dialect.CALCULIX
    for card in cards:
        reader.read(card)
    heading = next((card for card in cards if card.keyword == "HEADING"), cards[0])
    reader.model.cap = _cap(heading)
    blocks = reader.finished(cards[-1])
    steps = tuple(reader.steps)
    return InputDeck(name, kind, detected, blocks, reader.model, steps, without)


def _cap(heading: Card) -> float:
    """Stiffness cap in the heading of a deck that this package wrote; else none."""
    for line, text in zip(heading.data_line, heading.data, strict=True):
        key, _, value = text.partition(": ")
        if key == "maximum contact stiffness" and value != "none":
            return heading.number(line, value)
    return inf


#: Keywords of meshes.
_MESH = {"NODE", "ELEMENT", "NSET", "ELSET", "SURFACE", "SOLID SECTION"}
#: Model data that may stand in a step too.
_NAMED = {"SURFACE INTERACTION", "SURFACE BEHAVIOR", "FRICTION", "AMPLITUDE"}
#: What may be open, and what it stands in.
_OPEN = {"PART": "", "ASSEMBLY": "", "INSTANCE": "ASSEMBLY", "STEP": ""}


@dataclass
class _Reader:
    """Where in a deck a card stands: in a part, an instance, the assembly, a step."""

    model: ModelLines
    parts: dict[str, DeckPart] = field(default_factory=dict)
    part: DeckPart = field(default_factory=lambda: DeckPart(""))
    """The last one that was opened, before the first that of a flat deck."""
    blocks: Blocks = field(default_factory=Blocks)
    open: list[Card] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)

    @property
    def inside(self) -> str:
        """Keyword of what is open."""
        return self.open[-1].keyword if self.open else ""

    def read(self, card: Card) -> None:
        """Read one card."""
        word, inside = card.keyword, self.inside
        if word.startswith("END ") and word == f"END {inside}":
            self.open.pop()
        elif _OPEN.get(word) == inside:
            self._begin(card)
        elif inside == "STEP" and word not in _MESH and word not in _OPEN:
            if word in _NAMED:
                self.model.add(card)
            else:
                self.steps[-1].cards.append(card)
        elif word in _MESH and (inside == "PART" or (not self.parts and not inside)):
            self._in_part(card)
        elif word in {"NSET", "ELSET", "SURFACE"} and inside in {"ASSEMBLY", ""}:
            if word == "SURFACE":
                self.blocks.surfaces[card.parameter("NAME")] = card
            else:
                self.blocks.add_set(card)
        elif inside in {"ASSEMBLY", ""} and word not in _MESH and not word.startswith("END "):
            self.model.add(card)
        else:
            raise card.unread(f"in {self.open[-1].title if self.open else 'the model data'},")

    def _begin(self, card: Card) -> None:
        word = card.keyword
        self.open.append(card)
        if word == "PART":
            name = card.parameter("NAME")
            if name in self.parts:
                raise card.wrong(f"{name} twice", "it once")
            self.part = self.parts[name] = DeckPart(name)
        elif word == "STEP":
            large = any("NLGEOM" in s.card.parameters and s.large_rotations for s in self.steps)
            self.steps.append(Step(card, follows_large=large))
        elif word == "INSTANCE":
            part, name = card.parameter("PART"), card.parameter("NAME")
            if part not in self.parts or name in self.blocks.by_name:
                raise card.wrong(f"{name} of part {part}", "a name of its own, and a part")
            self.blocks.by_name[name] = len(self.blocks.instances)
            self.blocks.instances.append(placed(card, self.parts[part]))

    def _in_part(self, card: Card) -> None:
        word, part = card.keyword, self.part
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

    def finished(self, last: Card) -> Blocks:
        """All parts at their places.

        Raises
        ------
        DeckError
            A file that ends early, or without a step; a part that is not one solid.
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
            self.blocks.add_flat(self.part)
        for part in self.parts.values():
            if (count := len(part.pieces())) > 1:
                raise DeckError(
                    f"{part.kind_at}: *Element: got {count} solids in part {part.name}; expected "
                    "one: a part for each"
                )
        return self.blocks
