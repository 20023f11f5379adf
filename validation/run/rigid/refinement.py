"""What one refinement changes of a rigid answer: an error bar where there is no exact one.

Forces between rigid blocks are not unique: the answer is the one of least norm on the facets of
``[mesh]``, and its means follow the facets. How far they do is seen on facets of half the length.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from validation.errors import InputError
from validation.run.rigid.answer import RigidAnswer
from validation.run.rigid.assembly import RigidRun, run_rigid
from validation.scene.family import AssemblyScene
from validation.scene.read import SceneFile

#: Elements along every edge over those of the scene.
FACTOR = 2.0
#: Measures that are compared [MPa].
_COMPARED = ("p_eff", "p_eff_pooled", "p_max")


@dataclass(frozen=True)
class Refinement:
    """Measures of a scene and of the same scene with shorter facets."""

    n_contacts: int
    """Of the finer mesh."""
    class_changes: bool
    """Whether the mechanism class does."""
    finer: dict[str, float]
    """Measures of the finer mesh [MPa]; none where either holds nothing."""
    changes: dict[str, float]
    """Finer less the scene's own [MPa]."""

    @property
    def words(self) -> str:
        """What was found, for a line of text."""
        head = f"{self.n_contacts} contacts"
        if self.class_changes:
            return f"{head}: another mechanism class, the facets of [mesh] are too long"
        if not self.finer:
            return f"{head}: the same class, and no pressures to compare"
        parts = []
        for name, value in self.finer.items():
            own = value - self.changes[name]
            share = f" ({100.0 * self.changes[name] / own:+.2g} %)" if own else ""
            parts.append(f"{name} {value:.5g} MPa{share}")
        return f"{head}: {', '.join(parts)}"

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "n_contacts": self.n_contacts,
            "class_changes": self.class_changes,
            "values": self.finer,
            "changes": self.changes,
        }


def require_mesh(file: SceneFile) -> AssemblyScene:
    """Refuse scenes whose facets are given node by node or by triangles.

    Raises
    ------
    InputError
        Those, by name.
    """
    if not isinstance(file.scene, AssemblyScene) or file.scene.coarser(FACTOR) is None:
        raise InputError(
            f"{file.name}: --refine: its blocks have no mesh that could be refined; expected a "
            "scene that states how many elements a block has"
        )
    return file.scene


def refined(file: SceneFile, run: RigidAnswer) -> Refinement:
    """Solve the scene on facets of half the length and compare.

    Raises
    ------
    InputError
        A scene without a mesh.
    """
    finer = require_mesh(file).coarser(FACTOR)
    assert finer is not None
    assert isinstance(run, RigidRun)
    found = run_rigid(replace(file, scene=finer))
    one, other = run.measures, found.measures
    values: dict[str, float] = {}
    if one is not None and other is not None:
        values = {name: float(getattr(other, name)) for name in _COMPARED}
    return Refinement(
        n_contacts=found.result.n_contacts,
        class_changes=found.result.mechanism is not run.result.mechanism,
        finer=values,
        changes={name: value - float(getattr(one, name)) for name, value in values.items()},
    )
