"""The compiled loops of the explicit solver.

Arrays are [row][component][copy] (`fem.explicit.kernels.layout`), copies are SIMD lanes. Every
kernel has a plain twin in `tests.reference_kernels`, with which the tests compare it.

An argument that is None removes its branch when the kernel is compiled: an effect that is off
is not in the machine code. Rows are worked in fixed chunks and each chunk writes its own rows
and its own partial sums, so one and two threads give the same bits.

Loops over chunks are compiled twice from one source (`fem.explicit.kernels.forms`), for one thread
and for several: `SERIAL` and `PARALLEL`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

from fem.explicit.kernels import damping, frame, motion, stiffness, viscosity
from fem.explicit.kernels.forms import Forms
from fem.explicit.kernels.frame import fit_frames, place_force, set_spins
from fem.explicit.kernels.layout import widths
from fem.explicit.kernels.motion import (
    Applied,
    Damper,
    Drag,
    Loads,
    MovingRows,
    Placing,
    dot_lanes,
    enforce,
    viscous_power,
)
from fem.explicit.kernels.runs import add_at, dot_rows, hold
from geometry.compilation import Kernel

__all__ = [
    "PARALLEL",
    "SERIAL",
    "Applied",
    "Damper",
    "Drag",
    "KernelSet",
    "Loads",
    "MovingRows",
    "Placing",
    "add_at",
    "dot_lanes",
    "dot_rows",
    "enforce",
    "fit_frames",
    "hold",
    "place_force",
    "set_spins",
    "viscous_power",
    "widths",
]


@dataclass(frozen=True)
class KernelSet:
    """The kernels that share rows among threads, in one of their two forms."""

    stiffness_product: Callable[..., None]
    update: Kernel
    viscous_pressure: Callable[..., None]
    add_viscous_force: Callable[..., None]
    add_stiffness_damping: Callable[..., None]
    displacement_moments: Callable[..., None]
    block_frame_displacement: Callable[..., None]


def _kernel_sets() -> tuple[KernelSet, KernelSet]:
    """For one thread and for several; each kernel is in its module by its name."""
    modules = (stiffness, motion, viscosity, damping, frame)
    forms: dict[str, Forms] = {
        field.name: next(getattr(m, field.name) for m in modules if hasattr(m, field.name))
        for field in fields(KernelSet)
    }
    return (
        KernelSet(**{name: form.serial for name, form in forms.items()}),
        KernelSet(**{name: form.parallel for name, form in forms.items()}),
    )


SERIAL, PARALLEL = _kernel_sets()
