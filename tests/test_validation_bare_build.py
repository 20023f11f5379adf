"""What is off is absent: the solver beside a loop that was built without any effect."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest

from fem.explicit.contact import paired_kernel
from fem.explicit.kernels import motion, stiffness
from fem.explicit.step import System
from validation.effects import proof as bare_build
from validation.effects.costs import ready, undamped
from validation.effects.proof import (
    BareKernels,
    bare_run,
    prove_absent,
    solver_run,
    stripped_source,
)
from validation.scene.read import DeformableScene, load_scene

TINY = ["assembly.layers=1", "block.shift=0.5", "mesh.around=6", "mesh.radial=1", "mesh.axial=2"]

#: Forms of a process that has run the separate loop, then those that the solver adds.
FORMS = """
from tests.test_validation_bare_build import shared_kernels, tiny_system
from validation.effects.proof import bare_run, solver_run
from validation.effects.costs import compiled_forms
system = tiny_system()
bare_run(system, 3, shared_kernels())
before = compiled_forms()
solver_run(system, 3)
print(",".join(sorted(name for name, _ in compiled_forms() - before)))
"""


def shared_kernels() -> BareKernels:
    """Kernels of the solver with None for every effect, in the form of the bare ones."""

    def update(*arguments: Any) -> None:
        lanes, chunks, time_step, gain, mass, internal, row, applied, *moving = arguments
        motion.update.serial(
            lanes, chunks, None, None, None, time_step, gain, None, mass, internal,
            *(None, None, None, None), row, applied, None, *moving, None,
        )  # fmt: skip

    def product(*arguments: Any) -> None:
        *first, lanes = arguments
        stiffness.stiffness_product.serial(*first, None, lanes)

    def contact(*arguments: Any) -> None:
        paired_kernel.contact_forces.serial(*arguments, None, None, None)

    return BareKernels(product, update, contact)


def tiny_system() -> System:
    file = load_scene("tsb1-pipe", TINY)
    assert isinstance(file.scene, DeformableScene)
    return ready(undamped(file.scene), file.name)[0]


def test_source_without_effects_mentions_none() -> None:
    text = stripped_source(motion)
    code = text.partition('"""Central')[2].partition('"""')[2]
    lines = [line for line in code.splitlines() if "=" in line and "None" in line]
    # One test is left: whether anything is ever applied, which is no effect.
    assert not [line for line in lines if "applied" not in line]
    assert "after = minus(after, times(impulse, force))" in text


def test_a_forgotten_mention_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(bare_build._EFFECTS, motion, ({"impulse"}, set()))
    with pytest.raises(ValueError, match="impulse is still in the source"):
        stripped_source(motion)


def test_separate_loop_gives_the_bits_of_the_solver() -> None:
    system = tiny_system()
    ours, solver = bare_run(system, 500, shared_kernels()), solver_run(system, 500)
    assert abs(solver.displacement[0]).max() > 1e-6
    assert ours.bits() == solver.bits()


def test_solver_uses_no_compiled_form_that_the_loop_does_not_need() -> None:
    # Beside the forms of the separate loop the solver calls one sum: the work of its loads.
    found = subprocess.run(
        [sys.executable, "-c", FORMS], capture_output=True, text=True, check=True, timeout=600
    )
    assert found.stdout.strip() == "dot_at"


@pytest.mark.slow
def test_solver_has_the_instructions_and_bits_of_a_build_without_effects() -> None:
    # Every kind of instruction as often, in every kernel that takes effects. How many there are
    # depends on the vectors of the processor: a count of some hundreds shows that code was read.
    proof = prove_absent(tiny_system(), 100)
    assert proof.same_bits
    assert {count.kernel for count in proof.kernels} == {
        "stiffness_product",
        "contact_forces",
        "update",
    }
    for count in proof.kernels:
        assert count.same
        assert count.off > 100
    assert proof.holds
