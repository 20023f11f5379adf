"""Measurements kept by content, one row per run, in a file of results.

What counts is the blocks, the load, the material, the contact and the effects of the scene, the
setting, and the program that answered.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from validation.output.store import Layout, Store, content_key
from validation.scene.family import AssemblyScene
from validation.study.costs.settings import BaseMesh, CostSetting

#: What a measurement holds; another number where it holds other things than before.
_CONTENT = 3

LAYOUT = Layout(
    kind="cost",
    columns={
        "scene": "TEXT NOT NULL",
        "setting": "TEXT NOT NULL",
        "cpu_seconds": "REAL NOT NULL",
        "measurement": "TEXT NOT NULL",
    },
)


def scene_content(scene: AssemblyScene) -> dict[str, Any]:
    """What a scene states apart from how it is solved: no mesh, no solver."""
    return scene.model_dump(mode="json", exclude={"mesh", "rigid", "fem"})


def measurement_key(scene: AssemblyScene, base: BaseMesh, setting: CostSetting) -> str:
    """Digest of all that a measurement depends on; the name of a family is not among it."""
    return content_key(
        {
            "measurement": _CONTENT,
            "scene": scene_content(scene),
            "solver": scene.rigid.solver,
            "fem": scene.fem.model_dump(mode="json"),
            "mesh": setting.mesh(base),
            "elements": setting.mesh_words,
            "base": base.at(1),
            "method": setting.method,
            "changes": sorted(setting.changes),
            "ramp_factor": setting.ramp_factor,
            "hold_periods": setting.hold_periods,
            "damping_ratio": setting.damping_ratio,
        }
    )


class CostStore(Store):
    """Measurements in a file of results (use it as a context manager)."""

    def __init__(self, path: Path) -> None:
        """Open or create the file, or refuse it (`Store`)."""
        super().__init__(path, LAYOUT)

    def load(self, key: str) -> dict[str, Any] | None:
        """Return a measurement of this program to the last bit; None if there is none."""
        row = self.get(key)
        return None if row is None else json.loads(row["measurement"])

    def keep(self, key: str, name: str, setting: CostSetting, found: dict[str, Any]) -> None:
        """Write a measurement, whole or not at all."""
        about = {"scene": name, "setting": setting.name, "cpu_seconds": min(found["cpu_seconds"])}
        self.put(key, about | {"measurement": json.dumps(found, allow_nan=False)})
