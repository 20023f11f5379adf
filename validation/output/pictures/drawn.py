"""What pictures of deformable blocks show: two kinds of runs that answer by the same names."""

from __future__ import annotations

from typing import TypeAlias

from validation.run.curved.fields import CurvedFields
from validation.run.deformable import DeformableRun

DrawnState: TypeAlias = DeformableRun | CurvedFields
