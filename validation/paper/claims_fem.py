"""Claims that deformable blocks decide."""

from __future__ import annotations

from validation.paper.claims import Claim

FEM_CLAIMS: tuple[Claim, ...] = ()
