"""What becomes of each keyword and parameter: read, without influence on the answer, or rejected.

A keyword or a parameter that stands in no line of these tables is rejected by name.
"""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum

from fem.decks.keywords import DeckError
from fem.decks.read.cards import Card


class Dialect(StrEnum):
    """Program that a deck is written for: some keywords mean other things in the other one."""

    ABAQUS = "abaqus"
    """Abaqus."""
    CALCULIX = "calculix"
    """CalculiX."""


#: Keywords that are read, with their parameters: those that are read | those without influence.
_READ = """
AMPLITUDE: NAME DEFINITION TIME VALUE FIXED_INTERVAL BEGIN | SMOOTH
ASSEMBLY: NAME |
BOUNDARY: OP AMPLITUDE TYPE |
BULK VISCOSITY: |
CLEARANCE: MASTER SLAVE VALUE |
CLOAD: OP AMPLITUDE |
CONTACT: OP |
CONTACT CLEARANCE: NAME ADJUST CLEARANCE |
CONTACT CLEARANCE ASSIGNMENT: |
CONTACT INCLUSIONS: ALL_EXTERIOR |
CONTACT INTERFERENCE: SHRINK | TYPE OP AMPLITUDE
CONTACT PAIR: INTERACTION TYPE SMALL_SLIDING ADJUST MECHANICAL_CONSTRAINT | CPSET
CONTACT PROPERTY ASSIGNMENT: |
DAMPING: ALPHA BETA |
DENSITY: |
DLOAD: OP AMPLITUDE |
DSLOAD: OP AMPLITUDE ORIENTATION FOLLOWER CONSTANT_RESULTANT |
DYNAMIC: EXPLICIT | DIRECT ALPHA DIRECT_USER_CONTROL ELEMENT_BY_ELEMENT SCALE_FACTOR
ELASTIC: TYPE |
ELEMENT: TYPE ELSET |
ELSET: ELSET GENERATE INSTANCE | INTERNAL UNSORTED
END ASSEMBLY: |
END INSTANCE: |
END PART: |
END STEP: |
FRICTION: SHEAR_TRACTION_SLOPE | SLIP_TOLERANCE
HEADING: |
INITIAL CONDITIONS: TYPE |
INSTANCE: NAME PART |
MATERIAL: NAME |
NODE: NSET |
NSET: NSET GENERATE INSTANCE ELSET | INTERNAL UNSORTED FREQUENCY
ORIENTATION: NAME SYSTEM |
PART: NAME |
SOLID SECTION: ELSET MATERIAL CONTROLS | ORIENTATION
SPRING: ELSET |
STATIC: | DIRECT SOLVER
STEP: NAME NLGEOM | INC AMPLITUDE UNSYMM INCREMENT
SURFACE: NAME TYPE | INTERNAL
SURFACE BEHAVIOR: PRESSURE-OVERCLOSURE PENALTY |
SURFACE INTERACTION: NAME |
TRANSFORM: NSET TYPE |
"""

#: Keywords without influence on the answer: what is written, printed and kept for another run.
_IDLE = """
PREPRINT, RESTART, OUTPUT, NODE OUTPUT, ELEMENT OUTPUT, CONTACT OUTPUT, ENERGY OUTPUT,
NODE PRINT, EL PRINT, NODE FILE, EL FILE, CONTACT PRINT, CONTACT FILE, ELEMENT PRINT, FILE FORMAT,
ENERGY PRINT, ENERGY FILE, SECTION PRINT, MONITOR, FILTER, FILE OUTPUT, TIME POINTS, PRINT,
CONTROLS, SECTION CONTROLS, INCREMENTATION OUTPUT, DIAGNOSTICS, EXPANSION, CONDUCTIVITY,
SPECIFIC HEAT, PHYSICAL CONSTANTS, CONTACT CONTROLS
"""

#: Keywords that state what the solvers of this package do not compute, by what that is.
_OTHER = """
plasticity: PLASTIC, CYCLIC HARDENING, CREEP, DRUCKER PRAGER, CONCRETE, CONCRETE DAMAGED PLASTICITY,
  CONCRETE COMPRESSION HARDENING, CONCRETE TENSION STIFFENING, CONCRETE COMPRESSION DAMAGE,
  CONCRETE TENSION DAMAGE, MOHR COULOMB, DEFORMATION PLASTICITY
large strains: HYPERELASTIC, HYPERFOAM, VISCOELASTIC, VISCO, USER MATERIAL, MOONEY-RIVLIN
elements other than solids: RIGID BODY, SHELL SECTION, BEAM SECTION, BEAM GENERAL SECTION,
  MEMBRANE SECTION, MASS, DASHPOT, GAP, FLUID SECTION, TRUSS SECTION, CONNECTOR SECTION
constraints between nodes: TIE, EQUATION, MPC, COUPLING, KINEMATIC, DISTRIBUTING,
  CYCLIC SYMMETRY MODEL, DISTRIBUTING COUPLING, NETWORK MPC
heat: HEAT TRANSFER, COUPLED TEMPERATURE-DISPLACEMENT, UNCOUPLED TEMPERATURE-DISPLACEMENT,
  TEMPERATURE, CFLUX, DFLUX, FILM, RADIATE, GAP CONDUCTANCE, GAP HEAT GENERATION
vibrations: FREQUENCY, MODAL DYNAMIC, STEADY STATE DYNAMICS, MODAL DAMPING, COMPLEX FREQUENCY
other analyses: BUCKLE, SENSITIVITY, SUBMODEL, SUBSTRUCTURE GENERATE, GREEN, CRACK PROPAGATION,
  REFINE MESH, FEASIBLE DIRECTION, DESIGN VARIABLES, DESIGN RESPONSE, ROBUST DESIGN
changes between or in steps: MODEL CHANGE, CHANGE FRICTION, CHANGE CONTACT TYPE, CONTACT DAMPING,
  CHANGE SURFACE BEHAVIOR, CHANGE MATERIAL, CHANGE PLASTIC, CHANGE SOLID SECTION
meshes that are generated: NGEN, ELGEN, NFILL, NCOPY, ELCOPY, NMAP, SYSTEM
masses that are scaled: FIXED MASS SCALING, VARIABLE MASS SCALING
"""


def _names(text: str) -> list[str]:
    return [" ".join(name.split()) for name in text.split(",") if name.strip()]


def _table(text: str) -> dict[str, tuple[frozenset[str], frozenset[str]]]:
    result = {}
    for line in text.strip().splitlines():
        name, _, parameters = line.partition(":")
        read, idle = (
            frozenset(word.replace("_", " ") for word in part.split())
            for part in parameters.split("|")
        )
        result[name] = read, idle
    return result


READ = _table(_READ)
IDLE = frozenset(_names(_IDLE.replace("\n", " ")))
OTHER = {
    name: reason
    for block in _OTHER.strip().replace("\n  ", " ").splitlines()
    for reason, names in [block.split(":")]
    for name in _names(names)
}


#: Keywords by what is left without blanks, which CalculiX does not look at.
_SPELT = {"".join(name.split()): name for name in (*READ, *IDLE, *OTHER)}


def spelt(card: Card) -> Card:
    """Card with its keyword as the tables spell it: *Nodefile is *Node File."""
    return replace(card, keyword=_SPELT.get("".join(card.keyword.split()), card.keyword))


def check_words(cards: list[Card]) -> tuple[str, ...]:
    """Reject keywords and parameters that are not read, by line and reason.

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
            why = OTHER.get(card.keyword)
            raise DeckError(
                f"{card.at()}: {card.title}: "
                + (f"{why} is not covered" if why else "no keyword that is read")
                + "; expected elastic solids with contact, supports and loads (docs: decks)"
            )
        read, idle = READ[card.keyword]
        for name in card.parameters:
            if name in idle:
                without[f"{card.title}, {name.lower()}"] = None
            elif name not in read:
                raise DeckError(
                    f"{card.at()}: {card.title}: the parameter {name.lower()} is not read; "
                    f"expected one of {', '.join(sorted(map(str.lower, read | idle))) or 'none'}"
                )
    return tuple(without)


#: Keywords of one program alone.
_ABAQUS = {
    "CONTACT INTERFERENCE",
    "PART",
    "ASSEMBLY",
    "PREPRINT",
    "OUTPUT",
    "CONTACT",
    "BULK VISCOSITY",
}
_CALCULIX = {"NODE FILE", "EL FILE", "CONTACT FILE", "CONTACT PRINT", "NODE PRINT", "EL PRINT"}


def dialect_of(cards: list[Card], stated: Dialect | None = None) -> tuple[Dialect, str]:
    """Program that a deck is written for, and what says so.

    Flat decks without a keyword of one of the two are read as those of CalculiX.
    """
    if stated is not None:
        return stated, "stated"
    for card in cards:
        if card.keyword in _ABAQUS:
            return Dialect.ABAQUS, f"{card.at()}: {card.title}"
    for card in cards:
        if card.keyword in _CALCULIX:
            return Dialect.CALCULIX, f"{card.at()}: {card.title}"
    return Dialect.CALCULIX, "a flat deck; option --dialect abaqus reads it the other way"
