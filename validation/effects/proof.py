"""A build of the explicit loop without any optional effect, to prove that what is off is absent.

The kernels of `fem` take effects as arguments, and an argument that is None removes its branch
when the kernel is compiled. Here the same sources are compiled with every mention of an effect
cut out of the text: parameters, branches, arguments of calls. `BareLoop` is a loop of its own
around them. If both give the same bits and their machine code has the same instructions, an
effect that is off costs nothing.
"""

from __future__ import annotations

import ast
import inspect
import re
import types
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from fem.explicit.contact import paired_kernel as contact_kernels
from fem.explicit.kernels import motion, stiffness
from fem.explicit.kernels.layout import LaneArray, aligned_zeros
from fem.explicit.kernels.options import OPTIONS
from fem.explicit.solve import initial_state
from fem.explicit.state import State
from fem.explicit.step import System, bound, step

#: Parameters that are effects, in each module of kernels, and functions that only effects use.
_EFFECTS: dict[types.ModuleType, tuple[set[str], set[str]]] = {
    motion: (
        {
            "keep",
            "acceleration",
            "kinetic",
            "loss",
            "dissipated",
            "placing",
            "reference",
            "ratio",
            "elastic_before",
            "viscous_work",
        },
        {"dot_lanes", "enforce", "viscous_power"},
    ),
    stiffness: ({"torque"}, set()),
    contact_kernels: (
        {"normals", "slip", "sliding"},
        {"forget", "rub", "collect_forces", "_collect_chunk", "add_travel"},
    ),
}


#: Kernels of the loop that know effects, and their modules.
_KERNELS = {"stiffness_product": stiffness, "contact_forces": contact_kernels, "update": motion}


class _WithoutEffects(ast.NodeTransformer):
    """Cuts parameters that are None, and all that depends on them, out of a module."""

    def __init__(self, absent: set[str], unused: set[str]) -> None:
        self._absent, self._unused = absent, unused

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST | None:
        if node.name in self._unused:
            return None
        node.args.args = [a for a in node.args.args if a.arg not in self._absent]
        # One thread, and nothing of this build is kept: the kernels' cache knows files, not texts.
        node.decorator_list = [
            ast.parse("njit(**OPTIONS)", mode="eval").body
            if ast.unparse(decorator) == "serial_and_parallel"
            else decorator
            for decorator in node.decorator_list
        ]
        return self.generic_visit(node)

    def visit_If(self, node: ast.If) -> ast.AST | list[ast.stmt]:
        self.generic_visit(node)
        test = node.test
        if (
            isinstance(test, ast.Compare)
            and isinstance(test.left, ast.Name)
            and test.left.id in self._absent
        ):
            return node.body if isinstance(test.ops[0], ast.Is) else node.orelse
        return node

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        node.args = [a for a in node.args if not (isinstance(a, ast.Name) and a.id in self._absent)]
        return node


def stripped_source(module: types.ModuleType) -> str:
    """Source of a module of kernels without its effects.

    Raises
    ------
    ValueError
        When a mention of an effect is left.
    """
    absent, unused = _EFFECTS[module]
    tree = _WithoutEffects(absent, unused).visit(ast.parse(inspect.getsource(module)))
    left = {n.id for n in ast.walk(tree) if isinstance(n, ast.Name)} & (absent | unused)
    if left:
        raise ValueError(f"{module.__name__}: {', '.join(sorted(left))} is still in the source")
    return ast.unparse(ast.fix_missing_locations(tree))


def build_without_effects(module: types.ModuleType) -> dict[str, Any]:
    """Names of a module of kernels, built from its stripped source."""
    built = types.ModuleType(f"{module.__name__} without effects")
    code = compile(stripped_source(module), built.__name__, "exec")
    exec(code, built.__dict__)
    return built.__dict__


@dataclass(frozen=True)
class BareKernels:
    """Kernels whose source knows no effect."""

    stiffness_product: Callable[..., None]
    update: Callable[..., None]
    contact_forces: Callable[..., None]


def bare_kernels() -> BareKernels:
    """Build the kernels without effects; they are compiled when they are first called."""
    return BareKernels(
        **{name: build_without_effects(module)[name] for name, module in _KERNELS.items()}
    )


# ---------------------------------------------------------------------------------------------
# The loop


@dataclass
class BareState:
    """What evolves in a loop without effects: one array for each group."""

    displacement: list[LaneArray]
    velocity: list[LaneArray]

    def bits(self) -> bytes:
        """All arrays as bytes."""
        return b"".join(a.tobytes() for a in (*self.displacement, *self.velocity))


def bare_run(system: System, steps: int, kernels: BareKernels) -> BareState:
    """Central differences of blocks in contact: internal force, loads, contact, kick and drift.

    A loop written for this alone. It takes the constant arrays of a system (stiffness, mass,
    loads, contact), blocks in face-to-face contact without supports in float64, and calls nothing
    of `fem.explicit.step`.
    """
    bodies, dt = system.bodies, system.time_step
    (contact,) = system.model.interactions
    force: Any = bound(contact, bodies)
    data, work, law = force._data, force._work, force._constants
    shapes = [(body.n_rows, 3, body.lanes) for body in bodies]
    u, v, inner = ([aligned_zeros(s, np.float64) for s in shapes] for _ in range(3))
    applied = [aligned_zeros((b.n_applied, 3, b.lanes), np.float64) for b in bodies]

    def forces(time: float) -> None:
        for k, body in enumerate(bodies):
            rows = body.rows
            kernels.stiffness_product(
                *rows.packed, u[k].ravel(), inner[k].ravel(), body.lanes,
            )  # fmt: skip
            applied[k][:] = 0.0
            for load in body.loads:
                factor = 1.0 if load.amplitude is None else load.amplitude(time)
                np.add.at(applied[k].ravel(), load.applied.index, factor * load.values)
        kernels.contact_forces(data, tuple(a.ravel() for a in u), work, law)
        for k, (body, found) in enumerate(zip(bodies, force._collections, strict=True)):
            contact_kernels.collect_forces.serial(
                found.chunks, found.pointer, found.entries, data, work, body.lanes,
                applied[k].ravel(),
            )  # fmt: skip

    forces(0.0)
    for k, body in enumerate(bodies):
        total = -inner[k]
        assert body.applied_row is not None
        touched = body.applied_row >= 0
        total[touched] += applied[k][body.applied_row[touched]]
        v[k] -= 0.5 * dt * (total / body.mass[:, None, None])
    for number in range(steps):
        forces(number * dt)
        for k, body in enumerate(bodies):
            kernels.update(
                body.lanes, body.rows.chunks, dt, dt, body.mass, inner[k].ravel(),
                body.applied_row, applied[k].ravel(), u[k].ravel(), v[k].ravel(),
            )  # fmt: skip
    return BareState(u, v)


def solver_run(system: System, steps: int) -> BareState:
    """Return the same steps of the solver itself."""
    state: State = initial_state(system)
    for _ in range(steps):
        step(system, state)
    bodies = state.bodies
    return BareState([now.displacement for now in bodies], [now.velocity for now in bodies])


# ---------------------------------------------------------------------------------------------
# Machine code


@dataclass(frozen=True)
class InstructionCount:
    """Instructions of one kernel, with its effects off and built without them."""

    kernel: str
    off: int
    """The solver's kernel, compiled with None for every effect."""
    without: int
    """The kernel whose source knows no effect."""
    same: bool
    """Whether every kind of instruction occurs as often in both."""


_DEFINITION = re.compile(r"^define .*?\{$(.*?)^\}$", re.MULTILINE | re.DOTALL)
_OPCODE = re.compile(r"^\s+(?:%\S+ = )?(?:tail |musttail |notail )?([a-z]\w*)", re.MULTILINE)


def opcodes(function: Any) -> Counter[str]:
    """How often each instruction occurs in the optimised code of a compiled kernel.

    Wrappers for calls from Python, which unpack one argument after the other, do not count.
    """
    (signature,) = function.signatures
    text = function.inspect_llvm(signature)
    found: Counter[str] = Counter()
    for match in _DEFINITION.finditer(text):
        head = match.group(0).partition("\n")[0]
        if "@_ZN7cpython" not in head and "@cfunc" not in head:
            found.update(_OPCODE.findall(match.group(1)))
    return found


def count_instructions(kernels: BareKernels) -> tuple[InstructionCount, ...]:
    """Compare the build without effects, compiled by a run, with the code of the solver's."""
    counts = []
    for name, module in _KERNELS.items():
        built = getattr(kernels, name)
        a, b = opcodes(_compiled_with_none(getattr(module, name), built)), opcodes(built)
        counts.append(InstructionCount(name, a.total(), b.total(), a == b))
    return tuple(counts)


def _compiled_with_none(kernel: Any, built: Any) -> Any:
    """Compile the solver's kernel afresh for the same arguments and None for every effect."""
    from numba import types as kinds

    original = kernel.serial.py_func
    (given,) = built.signatures
    passed_on = kernel is motion.update
    if passed_on:
        given = (*given[:2], *given[2].types)
    values = dict(zip(_names(built.py_func), given, strict=True))
    signature = tuple(values.get(p, kinds.none) for p in _names(original))
    if passed_on:
        signature = (*signature[:2], kinds.Tuple(signature[2:]))
    fresh = njit(**OPTIONS)(original)
    fresh.compile(signature)
    return fresh


def _names(function: Any) -> list[str]:
    """Parameters of a kernel; those that it passes on have the names of the chunk's function."""
    names = list(inspect.signature(function).parameters)
    if "motion" in names:
        names = list(inspect.signature(function.__globals__["_update_4"]).parameters)[1:]
    return names


@dataclass(frozen=True)
class BareProof:
    """What is off is absent: the solver beside a build without effects."""

    steps: int
    """Steps of both."""
    same_bits: bool
    """Whether displacements and velocities are the same to the last bit."""
    kernels: tuple[InstructionCount, ...]
    """Instructions of every kernel of the loop that knows effects."""

    @property
    def holds(self) -> bool:
        """Whether bits and instructions are the same."""
        return self.same_bits and all(count.same for count in self.kernels)


def prove_absent(system: System, steps: int = 200) -> BareProof:
    """Run the solver and the build without effects on blocks in contact, and compare both."""
    kernels = bare_kernels()
    same = bare_run(system, steps, kernels).bits() == solver_run(system, steps).bits()
    return BareProof(steps, same, count_instructions(kernels))
