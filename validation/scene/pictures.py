"""``[pictures]`` of a scene: size, font and kind of what a command draws."""

from __future__ import annotations

import difflib
from typing import Annotated, Literal

from pydantic import Field, field_validator

from validation.scene.sections import Section

Kind = Literal["png", "svg", "pdf"]


class PicturesSection(Section):
    """``[pictures]``: how pictures are drawn; no number depends on it."""

    format: Kind = "png"
    """Kind of file: ``png``, ``svg`` or ``pdf`` (lines and letters, for print)."""
    width: Annotated[float, Field(ge=40.0, le=2000.0)] | None = None
    """Width of a picture [mm], such as a journal's column; by default as its panels need."""
    font: str | None = None
    """Family of fonts, as the system names it; by default DejaVu Sans."""
    font_size: Annotated[float, Field(ge=3.0, le=72.0)] | None = None
    """Small print [pt]; titles are larger in proportion. By default 9."""

    @field_validator("font")
    @classmethod
    def _font_that_is_here(cls, font: str | None) -> str | None:
        if font is None:
            return None
        from matplotlib import font_manager

        known = {entry.name for entry in font_manager.fontManager.ttflist}
        if font in known:
            return font
        near = difflib.get_close_matches(font, known, n=3) or sorted(known)[:6]
        raise ValueError(
            "not installed here; expected a family of fonts such as " + ", ".join(map(repr, near))
        )
