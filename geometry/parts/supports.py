"""What holds blocks that deform: parts of their surfaces held, moved or on springs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.errors import RefusedError
from geometry.mesh import FloatArray, ReadOnlyArrays
from geometry.parts.placed import AnyBlocks
from geometry.parts.regions import Where, check_blocks, check_region, region_nodes


class SupportError(RefusedError):
    """A support that the blocks cannot have."""


#: Name of a support that pushes its block.
PUSH = "push"
#: Part of a motion that may lie across the directions that are held: digits of a scene [-].
_ACROSS = 1e-3


@dataclass(frozen=True)
class HeldFace(ReadOnlyArrays):
    """Part of the surface of a block that is held, moved or on springs while a load acts."""

    block: int
    """Its block, which deforms."""
    face: Where
    """Name of the face, or where on the surface."""
    directions: FloatArray | None = None
    """Unit vectors, world axes, along which it is held, orthogonal to each other, (n, 3); None: in
    all three. A roller is held along its normal."""
    displacement: FloatArray | None = None
    """By which the held components move, (3,) [mm]; None: they stay where they are."""
    path: tuple[tuple[float, float], ...] = ()
    """Times [s] and shares of the displacement, straight between; (): from none to all of it."""
    spring: float | None = None
    """Stiffness of springs per area between the surface and the ground along the directions
    [N/mm³]; None: held fast."""
    name: str = ""
    """In tables of reactions; empty: of the face."""

    def __post_init__(self) -> None:
        super().__post_init__()
        directions = self.directions
        if directions is not None:
            product = directions @ directions.T
            if directions.ndim != 2 or np.abs(product - np.eye(len(directions))).max() > 1e-9:
                raise SupportError(
                    f"support: got directions {directions.tolist()}; expected unit vectors that "
                    "are orthogonal to each other, (n, 3)"
                )
        if self.spring is not None and not (np.isfinite(self.spring) and self.spring > 0.0):
            raise SupportError(
                f"support {self.title}: got springs of {self.spring}; expected a positive "
                "stiffness in N/mm³"
            )
        if self.displacement is not None and not np.isfinite(self.displacement).all():
            raise SupportError(
                f"support {self.title}: got a motion by {self.displacement.tolist()}; expected "
                "three finite mm"
            )
        times = [time for time, _ in self.path]
        late = bool(times) and (times[0] < 0.0 or self.path[0][1] != 0.0)
        if late or len(times) == 1 or times != sorted(set(times)):
            raise SupportError(
                f"support {self.title}: got the path {[list(row) for row in self.path]}; expected "
                "two rows at least, increasing times and a first share of 0"
            )
        self._refuse_free_motion()
        if self.spring is not None and self.displacement is not None:
            raise SupportError(
                "support: got springs that move; expected springs or a motion, one of the two"
            )

    def _refuse_free_motion(self) -> None:
        """Reject a motion across the directions that are held: nothing would come of it."""
        move = self.displacement
        if move is None:
            return
        lost = move - move @ self.axes.T @ self.axes
        if np.abs(lost).max() > _ACROSS * np.abs(move).max():
            raise SupportError(
                f"support {self.title}: got a motion by {move.tolist()} where it is held along "
                f"{self.axes.tolist()} alone: nothing moves it by {lost.round(12).tolist()}; "
                "expected a motion along the directions that are held"
            )

    @property
    def axes(self) -> FloatArray:
        """Directions along which it is held, (n, 3)."""
        return np.eye(3) if self.directions is None else self.directions

    @property
    def moves(self) -> bool:
        """Whether it moves along a direction along which it is held."""
        return self.displacement is not None and bool((self.axes @ self.displacement).any())

    @property
    def is_push(self) -> bool:
        """Whether it moves a block against what holds it, and rigid blocks give its limit."""
        return self.moves and self.name == PUSH

    @property
    def title(self) -> str:
        """Its name, or that of the face."""
        return self.name or str(self.face)

    def check(self, assembly: AnyBlocks) -> None:
        """Reject a region without nodes, and springs without facets."""
        check_blocks(assembly, np.array([self.block]), f"support {self.title}", SupportError)
        if isinstance(self.face, str) or self.spring is not None:
            check_region(assembly, np.array([self.block]), self.face, "support", SupportError)
        elif not len(region_nodes(assembly, self.block, self.face)):
            raise SupportError(
                f"support: no surface node of block {assembly.named(self.block)} lies on "
                f"{self.face}; expected a region with nodes (are coordinates in mm?)"
            )
