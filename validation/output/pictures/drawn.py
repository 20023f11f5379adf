"""What pictures of deformable blocks show: a run by these names alone."""

from __future__ import annotations

from typing import TypeAlias

from validation.run.deformable import DeformableRun

DrawnState: TypeAlias = DeformableRun
