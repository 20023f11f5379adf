"""Lines of a deck of two cubes, and the same with a line changed."""

from __future__ import annotations

import random

#: Two cubes of 1 mm on top of each other, E = 1000 MPa, no lateral strain, pressed with 2 MPa.
CUBES = """*Node, nset=ALL
1, 0, 0, 0
2, 1, 0, 0
3, 1, 1, 0
4, 0, 1, 0
5, 0, 0, 1
6, 1, 0, 1
7, 1, 1, 1
8, 0, 1, 1
11, 0, 0, 1
12, 1, 0, 1
13, 1, 1, 1
14, 0, 1, 1
15, 0, 0, 2
16, 1, 0, 2
17, 1, 1, 2
18, 0, 1, 2
*Element, type=C3D8, elset=LOWER
1, 1, 2, 3, 4, 5, 6, 7, 8
*Element, type=C3D8, elset=UPPER
2, 11, 12, 13, 14, 15, 16, 17, 18
*Nset, nset=FOOT
1, 2, 3, 4
*Nset, nset=CORNER
11
*Nset, nset=NEXT
12
*Surface, name=TOP
LOWER, S2
*Surface, name=UNDER
UPPER, S1
*Material, name=M
*Elastic
1000., 0.
*Solid Section, elset=LOWER, material=M
*Solid Section, elset=UPPER, material=M
*Surface Interaction, name=I
*Surface Behavior, pressure-overclosure=LINEAR
500.
*Contact Pair, interaction=I, type=SURFACE TO SURFACE
UNDER, TOP
*Boundary
FOOT, 1, 3
CORNER, 1, 2
NEXT, 2
*Step
*Static
*Dload
UPPER, P2, 2.
*Node Print, nset=ALL
U
*End Step
""".splitlines()


def changed(old: str, new: str, lines: list[str] = CUBES) -> list[str]:
    text = "\n".join(lines)
    assert old in text
    return text.replace(old, new, 1).splitlines()


def changed_lines(lines: list[str], source: random.Random) -> list[str]:
    """One to three lines dropped, doubled, swapped, cut short or with another entry."""
    lines = list(lines)
    for _ in range(source.randint(1, 3)):
        at = source.randrange(len(lines))
        kind = source.choice(["drop", "double", "swap", "cut", "entry", "entry"])
        if kind == "drop" and len(lines) > 1:
            del lines[at]
        elif kind == "double":
            lines.insert(at, lines[at])
        elif kind == "swap":
            lines[at], lines[at - 1] = lines[at - 1], lines[at]
        elif kind == "cut":
            end = source.choice(["", ",", "*", "=", "é", " 9"])
            lines[at] = lines[at][: source.randint(0, len(lines[at]))] + end
        else:
            words = lines[at].split(",")
            entries = ["", "0", "-1", "1", "2", "0.5", "1e400", "nan", "99", "x", "C3D8I", "FOOT"]
            words[source.randrange(len(words))] = source.choice(entries)
            lines[at] = ",".join(words)
    return lines
