"""What becomes of each keyword and parameter: read, without influence on the answer, or rejected.

A keyword or a parameter that stands in no line of these tables is rejected by its line. The manual
has the same table, docs/tutorials/decks.md.
"""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum

from fem.decks.read.cards import Card


class Dialect(StrEnum):
    """Program that a deck is written for: some keywords mean other things in the other one."""

    ABAQUS = "abaqus"
    """Abaqus."""
    CALCULIX = "calculix"
    """CalculiX."""


#: Keywords that are read, with their parameters: those that are read | those without influence.
_READ = """
AMPLITUDE: NAME DEFINITION |
ASSEMBLY: NAME |
BOUNDARY: OP AMPLITUDE |
CLEARANCE: MASTER SLAVE VALUE |
CLOAD: OP AMPLITUDE |
CONTACT: OP |
CONTACT CLEARANCE: NAME ADJUST CLEARANCE |
CONTACT INCLUSIONS: ALL_EXTERIOR |
CONTACT PAIR: INTERACTION TYPE SMALL_SLIDING ADJUST | MECHANICAL_CONSTRAINT CPSET
DAMPING: ALPHA BETA |
DLOAD: OP AMPLITUDE |
DSLOAD: OP AMPLITUDE ORIENTATION FOLLOWER | CONSTANT_RESULTANT
DYNAMIC: EXPLICIT DIRECT | ALPHA DIRECT_USER_CONTROL ELEMENT_BY_ELEMENT SCALE_FACTOR
ELASTIC: TYPE |
ELEMENT: TYPE ELSET |
ELSET: ELSET GENERATE INSTANCE | INTERNAL UNSORTED
FRICTION: SHEAR_TRACTION_SLOPE | SLIP_TOLERANCE
INSTANCE: NAME PART |
MATERIAL: NAME |
NODE: NSET |
NSET: NSET GENERATE INSTANCE | INTERNAL UNSORTED
ORIENTATION: NAME SYSTEM |
PART: NAME |
SOLID SECTION: ELSET MATERIAL | ORIENTATION CONTROLS
STATIC: | DIRECT SOLVER
STEP: NAME NLGEOM | INC AMPLITUDE UNSYMM INCREMENT
SURFACE: NAME TYPE | INTERNAL
SURFACE BEHAVIOR: PRESSURE-OVERCLOSURE | PENALTY
SURFACE INTERACTION: NAME |
"""

#: Keywords that are read and have no parameters.
_BARE = """
BULK VISCOSITY, CONTACT CLEARANCE ASSIGNMENT, CONTACT PROPERTY ASSIGNMENT, DENSITY, END ASSEMBLY,
END INSTANCE, END PART, END STEP, HEADING
"""

#: Keywords without influence on the answer: what is written, printed and kept for another run.
_IDLE = """
CONDUCTIVITY, CONTACT CONTROLS, CONTACT FILE, CONTACT OUTPUT, CONTACT PRINT, CONTROLS, DIAGNOSTICS,
EL FILE, EL PRINT, ELEMENT OUTPUT, ELEMENT PRINT, ENERGY FILE, ENERGY OUTPUT, ENERGY PRINT,
EXPANSION, FILE FORMAT, FILE OUTPUT, FILTER, INCREMENTATION OUTPUT, MONITOR, NODE FILE, NODE OUTPUT,
NODE PRINT, OUTPUT, PHYSICAL CONSTANTS, PREPRINT, PRINT, RESTART, SECTION CONTROLS, SECTION PRINT,
SPECIFIC HEAT, TIME POINTS
"""


def _names(text: str, by: str = ",") -> frozenset[str]:
    return frozenset(" ".join(name.replace("_", " ").split()) for name in text.split(by) if name)


_NONE = frozenset[str]()
#: Parameters of each keyword: those that are read, and those without influence.
READ = dict.fromkeys(_names(_BARE), (_NONE, _NONE))
for _line in _READ.strip().splitlines():
    _name, _, _parameters = _line.partition(":")
    _read, _, _idle = _parameters.partition("|")
    READ[_name] = _names(_read, " "), _names(_idle, " ")
IDLE = _names(_IDLE)
#: Keywords by what is left without blanks, which CalculiX does not look at.
_SPELT = {"".join(name.split()): name for name in (*READ, *IDLE)}


def spelt(card: Card) -> Card:
    """Card with its keyword as the tables spell it: ``*Nodefile`` is ``*Node File``."""
    return replace(card, keyword=_SPELT.get("".join(card.keyword.split()), card.keyword))


def check_words(cards: list[Card]) -> tuple[str, ...]:
    """Reject keywords and parameters that are not read, by their line.

    Returns
    -------
    tuple[str, ...]
        Those that are there and have no influence, each once.

    Raises
    ------
    DeckError
        The first.
    """
    without = dict[str, None]()
    for card in cards:
        if card.keyword in IDLE:
            without[card.title] = None
            continue
        if card.keyword not in READ:
            raise card.unread()
        read, idle = READ[card.keyword]
        for name in card.parameters:
            if name in idle:
                without[f"{card.title}, {name.lower()}"] = None
            elif name not in read:
                raise card.unread(name.lower())
    return tuple(without)


#: Keywords of one program alone.
_ABAQUS = {"PART", "ASSEMBLY", "PREPRINT", "OUTPUT", "CONTACT", "BULK VISCOSITY"}
_CALCULIX = {"NODE FILE", "EL FILE", "CONTACT FILE", "CONTACT PRINT", "NODE PRINT", "EL PRINT"}


def dialect_of(cards: list[Card], stated: Dialect | None = None) -> tuple[Dialect, str]:
    """Program that a deck is written for, and what says so.

    Flat decks without a keyword of one of the two are read as those of CalculiX.
    """
    if stated is not None:
        return stated, "stated"
    for dialect, own in ((Dialect.ABAQUS, _ABAQUS), (Dialect.CALCULIX, _CALCULIX)):
        for card in cards:
            if card.keyword in own:
                return dialect, f"{card.at()}: {card.title}"
    return Dialect.CALCULIX, "a flat deck; option --dialect abaqus reads it the other way"
