"""The problem of a scene as it is refined."""

from __future__ import annotations

from fem import Problem
from tests.support.face import scene_problem
from tests.support.own_blocks import deformable


def stated(name: str, *settings: str) -> Problem:
    scene = deformable(name, *(settings or ("assembly.layers=1",)))
    return scene_problem(scene, name)
