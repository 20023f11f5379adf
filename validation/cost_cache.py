"""Cache of measurements: one JSON file per run, named by the hash of what was run.

A file is there whole or not at all, so a process killed at any moment loses at most the run it
was doing, and the next call goes on from there. What counts is the content: the blocks, the load,
the material, the contact and the effects of the scene, the setting, and the code that answered.
"""

from __future__ import annotations

import functools
import hashlib
import json
from importlib import metadata
from pathlib import Path
from typing import Any

import fem
import geometry
import mbd
from validation.cost_measure import Measurement
from validation.cost_settings import BaseMesh, CostSetting
from validation.errors import InputError
from validation.files import prepare_folder, write_whole
from validation.scene import TubeScene

#: Raised when what a file holds changes its meaning.
FORMAT = 1


@functools.cache
def code_version() -> str:
    """Version of the program and digest of the source of its solvers."""
    digest = hashlib.sha256()
    for package in (geometry, mbd, fem):
        assert package.__file__ is not None
        folder = Path(package.__file__).parent
        for path in sorted(folder.rglob("*.py")):
            digest.update(path.relative_to(folder.parent).as_posix().encode())
            digest.update(path.read_bytes())
    try:
        version = metadata.version("tubelock")
    except metadata.PackageNotFoundError:
        version = "not installed"
    return f"{version}, {digest.hexdigest()[:16]}"


def scene_content(scene: TubeScene) -> dict[str, Any]:
    """What a scene states apart from how it is solved: no mesh, no solver."""
    content: dict[str, Any] = scene.model_dump(mode="json", exclude={"mesh", "rigid", "fem"})
    return content


def content_key(scene: TubeScene, base: BaseMesh, setting: CostSetting) -> str:
    """Hash of all that a measurement depends on; the name of a family is not among it."""
    assert scene.fem is not None
    content = {
        "format": FORMAT,
        "version": code_version(),
        "scene": scene_content(scene),
        "solver": scene.rigid.solver,
        "fem": scene.fem.model_dump(mode="json"),
        "mesh": setting.mesh(base),
        "base": base.at(1),
        "method": setting.method,
        "changes": sorted(setting.changes),
        "ramp_factor": setting.ramp_factor,
        "hold_periods": setting.hold_periods,
        "damping_ratio": setting.damping_ratio,
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


class CostCache:
    """Measurements in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def prepare(self) -> None:
        """Create the folder.

        Raises
        ------
        InputError
            When it cannot be written.
        """
        prepare_folder(self.folder)

    def path(self, key: str) -> Path:
        """File of a measurement."""
        return self.folder / f"{key}.json"

    def load(self, key: str) -> Measurement | None:
        """Return a measurement to the last bit; None if there is none.

        Raises
        ------
        InputError
            A file that holds something else.
        """
        path = self.path(key)
        try:
            text = path.read_text("utf-8")
        except FileNotFoundError:
            return None
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
        try:
            return Measurement.from_json(json.loads(text)["measurement"])
        except (ValueError, TypeError, KeyError):
            raise InputError(
                f"{path}: is not a measurement of `tubelock cost`; delete the file, and the run "
                "is done again"
            ) from None

    def store(self, key: str, name: str, setting: CostSetting, found: Measurement) -> None:
        """Write a measurement, whole or not at all."""
        data = {"scene": name, "setting": setting.name, "measurement": found.as_json()}
        text = json.dumps(data, allow_nan=False) + "\n"
        write_whole(self.path(key), lambda path: path.write_text(text, "utf-8"))
