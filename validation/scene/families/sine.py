"""Tubes of Sine Blocks, ``[block] type = "sine"``."""

from __future__ import annotations

from math import atan, degrees
from typing import Any

from pydantic import ValidationError, ValidatorFunctionWrapHandler, field_validator

from geometry.families.sine_block import LayerTurn
from geometry.families.tube import SineTube
from validation.scene.family import RoundScene, family
from validation.scene.sections import section_of

#: Slope beyond which the joints of a wave are almost upright [°]; the paper's are at most 76°.
_STEEP = 76.0


_AssemblyKeys: Any = section_of(SineTube, keys=("layers", "turn"))


class SineTubeAssemblySection(_AssemblyKeys):  # type: ignore[misc]
    """``[assembly]`` of a tube of Sine Blocks."""

    @field_validator("turn", mode="wrap")
    @classmethod
    def _words_or_waves(cls, value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        try:
            return handler(value)
        except ValidationError:
            words = ", ".join(f'"{turn}"' for turn in LayerTurn)
            raise ValueError(f"expected {words} or a whole number of waves") from None


def _as_in_the_paper(block: Any) -> dict[str, int]:
    """Facets of the paper's means: as many along each wave, through the wall and along the axis."""
    return {"around": 28 * max(1, round(2.0 * block.frequency)), "radial": 8, "axial": 20}


class TubeScene(RoundScene):
    """A tube of Sine Blocks."""

    assembly: SineTubeAssemblySection

    @property
    def caution(self) -> str | None:
        """Steep waves: their joints are almost upright, and thin where they turn."""
        angle = degrees(atan(self.stated.block.steepest_slope))
        if angle <= _STEEP:
            return None
        return (
            f"block.amplitude = {self.block.amplitude:g} mm makes joints as steep as {angle:.0f}° "
            f"at the outer radius; usual are at most {_STEEP:g}°: is it meant?"
        )

    def fewer_elements(self, share: float) -> dict[str, Any]:
        """Keep at least two elements a wave."""
        result = super().fewer_elements(share)
        least = min(self.mesh.around, 2 * self.parts_of_a_block[0])
        return result | {"around": max(result.get("around", self.mesh.around), least)}


family(TubeScene, "sine", "geometry.families.tube:SineTube", default=_as_in_the_paper)
