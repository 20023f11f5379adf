"""Whether a short tube is locked by its blocks, or by the frames at its ends.

Between two frames a few layers can be locked whose blocks, in a longer tube, are not: tubes of
hexagon-based blocks under internal pressure are. More layers tell.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from mbd import MechanismClass
from validation.errors import InputError
from validation.run.rigid.answer import RigidAnswer
from validation.run.rigid.assembly import run_rigid
from validation.scene.families.hexagon import HexagonTubeScene
from validation.scene.family import RoundScene
from validation.scene.read import SceneFile

#: Layers of the paper's tubes: a shorter one is compared with one as long.
LONG_TUBE = 12


@dataclass(frozen=True)
class Unlocking:
    """Classes of a tube by its number of layers."""

    classes: dict[int, MechanismClass]
    """Of the numbers of layers that were tried, ascending."""
    layers: int | None
    """The least number of layers with which the tube is not locked; None: none was found."""

    @property
    def words(self) -> str:
        """What was found, for a line of text."""
        tried = ", ".join(f"{layers}: {found}" for layers, found in self.classes.items())
        head = "locked with every number tried" if self.layers is None else f"{self.layers} layers"
        return f"{head} (on this mesh, frames held; {tried})"


def require_tube(file: SceneFile) -> RoundScene:
    """Return the scene if it is a tube.

    Raises
    ------
    InputError
        For any other.
    """
    if not isinstance(file.scene, RoundScene):
        raise InputError(
            f"{file.name}: --layers-to-unlock: block.type {file.scene.block.type!r} makes no tube; "
            'expected "sine" or "hexagon"'
        )
    return file.scene


def class_with_layers(file: SceneFile, layers: int) -> MechanismClass:
    """Mechanism class, frames held, of a tube with another number of layers.

    Raises
    ------
    InputError
        For a scene that is no tube, or cannot be built so.
    """
    scene = require_tube(file).changed({"assembly.layers": layers})
    return run_rigid(replace(file, scene=scene)).result.mechanism


def layers_to_unlock(file: SceneFile, most: int = 4 * LONG_TUBE) -> Unlocking:
    """Find the least number of layers with which a tube is not locked.

    Doubled until it is not, then halved in between: a mechanism of some layers is taken to be one
    of more layers too.

    Raises
    ------
    InputError
        For a scene that is no tube, or cannot be built with fewer layers.
    """
    found: dict[int, MechanismClass] = {}

    def locked(layers: int) -> bool:
        found[layers] = class_with_layers(file, layers)
        return found[layers] is MechanismClass.LOCKED

    low, high = 0, 1
    while locked(high):
        low, high = high, 2 * high
        if high > most:
            return Unlocking(dict(sorted(found.items())), None)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if locked(middle) else (low, middle)
    return Unlocking(dict(sorted(found.items())), high)


def frame_warning(file: SceneFile, run: RigidAnswer) -> str | None:
    """Say where a short tube of hexagon-based blocks is locked by its frames alone."""
    scene = file.scene
    if not isinstance(scene, HexagonTubeScene) or scene.assembly.layers >= LONG_TUBE:
        return None
    if run.result.mechanism is not MechanismClass.LOCKED:
        return None
    other = class_with_layers(file, LONG_TUBE)
    if other is MechanismClass.LOCKED:
        return None
    return (
        f"{scene.assembly.layers} layers are locked by the frames at their ends, not by the "
        f"blocks: with {LONG_TUBE} layers the tube is {other}; --layers-to-unlock finds how many "
        "it takes"
    )


def unlocking_json(warning: str | None, found: Unlocking | None) -> dict[str, Any]:
    """Warning and layers as plain data; nothing where there is neither."""
    data: dict[str, Any] = {} if warning is None else {"frame_warning": warning}
    if found is not None:
        classes = {str(layers): str(name) for layers, name in found.classes.items()}
        data["layers_to_unlock"] = {"layers": found.layers, "classes": classes}
    return data
