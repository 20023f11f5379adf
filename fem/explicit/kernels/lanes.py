"""SIMD lanes for numba: short vectors of neighbouring copies, kept in registers.

numba vectorises a loop over copies only after proving that no two arrays overlap, and it does
not keep the three sums of a row in registers across the row's neighbours. Both cost a factor
of two. So this module gives the kernels a vector type of fixed width (an LLVM vector, which
LLVM maps to whatever the processor has: one or two AVX-512 registers, four AVX2 ones, …), the
operators + - * / on it and the few functions they need. Nothing here knows mechanics.
"""

# mypy: disable-error-code="misc, untyped-decorator"

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import binding, ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, models, register_model

#: Entries of float64 in a register of the processor. Results do not depend on it: every lane sums
#: by itself.
REGISTER_DOUBLES = 8 if binding.get_host_cpu_features().get("avx512f", False) else 4

#: Alignment of arrays [bytes]: that of their numbers.
_ALIGNED = 8

#: Added to a float64 below 2^50, it rounds it to a whole number.
ROUNDING_SHIFT = 1.5 * 2.0**52


class LanesType(types.Type):
    """Numba type of a vector of ``width`` numbers of float64."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(name=f"Lanes({width})")


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    """An LLVM vector value."""

    def __init__(self, manager: Any, lanes: LanesType) -> None:
        super().__init__(manager, lanes, ir.VectorType(ir.DoubleType(), lanes.width))


def _pointer(
    context: Any, builder: Any, array_type: Any, array: Any, index: Any, vector: Any
) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


def lane_operations(width: int) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return ``load(array, index)`` and ``zero()`` for vectors of ``width`` entries.

    ``index`` counts scalars from the first entry of a C-contiguous array, whatever its shape.
    Nothing checks bounds.
    """
    lanes = LanesType(width)

    @intrinsic
    def load(typing_context: Any, array: Any, index: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            vector = context.get_value_type(lanes)
            array_type = signature.args[0]
            pointer = _pointer(context, builder, array_type, args[0], args[1], vector)
            return builder.load(pointer, align=_ALIGNED)

        return lanes(array, types.intp), code

    @intrinsic
    def zero(typing_context: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return ir.Constant(context.get_value_type(lanes), None)

        return lanes(), code

    return load, zero


def _vector_type(kinds: Any) -> LanesType | None:
    """Type of the vectors among some operands, which else are scalars; None for other operands."""
    vectors = [kind for kind in kinds if isinstance(kind, LanesType)]
    known = all(isinstance(kind, LanesType | types.Number) for kind in kinds)
    return vectors[0] if vectors and known else None


def _as_vectors(context: Any, builder: Any, signature: Any, args: Any) -> list[Any]:
    """Operands of an operation on vectors: a scalar fills every entry."""
    lanes = _vector_type(signature.args)
    assert lanes is not None
    vector = context.get_value_type(lanes)
    return [
        value
        if isinstance(kind, LanesType)
        else _splat(builder, context.cast(builder, value, kind, types.float64), vector)
        for kind, value in zip(signature.args, args, strict=True)
    ]


def _vector_operator(symbol: Any, instruction: str) -> None:
    """Let an operator of Python work on vectors, entry by entry; one side may be a scalar."""

    class Typing(AbstractTemplate):
        def generic(self, args: Any, _: Any) -> Any:
            lanes = _vector_type(args)
            return None if lanes is None else signature(lanes, *args)

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return getattr(builder, instruction)(*_as_vectors(context, builder, signature, args))

    infer_global(symbol)(Typing)
    for sides in ((LanesType, LanesType), (types.Number, LanesType), (LanesType, types.Number)):
        lower_builtin(symbol, *sides)(code)


for _symbol, _instruction in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _vector_operator(_symbol, _instruction)


@intrinsic
def store(typing_context: Any, array: Any, index: Any, value: Any) -> Any:
    """Write a vector to ``array`` from scalar number ``index`` on."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array_type = signature.args[0]
        pointer = _pointer(context, builder, array_type, args[0], args[1], args[2].type)
        builder.store(args[2], pointer, align=_ALIGNED)
        return context.get_dummy_value()

    return types.void(array, types.intp, value), code


@intrinsic
def multiply_add(typing_context: Any, factor: Any, value: Any, total: Any) -> Any:
    """Return factor · value + total, rounded once; some of them may be scalars."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        operands = _as_vectors(context, builder, signature, args)
        vector = operands[0].type
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(vector, [vector] * 3), f"llvm.fma.v{vector.count}f64"
        )
        return builder.call(function, operands)

    lanes = _vector_type((factor, value, total))
    return lanes(factor, value, total), code


def _splat(builder: Any, scalar: Any, vector: Any) -> Any:
    undefined = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(undefined, scalar, ir.Constant(ir.IntType(32), 0))
    mask = ir.Constant(ir.VectorType(ir.IntType(32), vector.count), None)
    return builder.shuffle_vector(first, undefined, mask)


@intrinsic
def entry(typing_context: Any, value: Any, index: Any) -> Any:
    """Return one scalar of a vector."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.extract_element(args[0], args[1])

    return types.float64(value, types.intp), code


@intrinsic
def square_root(typing_context: Any, value: Any) -> Any:
    """Return the square root of every entry."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        vector = args[0].type
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(vector, [vector]), f"llvm.sqrt.v{vector.count}f64"
        )
        return builder.call(function, [args[0]])

    return value(value), code


@intrinsic
def any_below(typing_context: Any, value: Any, bound: Any) -> Any:
    """Return whether at least one entry of a vector is less than a scalar."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        vector = args[0].type
        below = builder.fcmp_ordered("<", args[0], _splat(builder, args[1], vector))
        bits = builder.bitcast(below, ir.IntType(vector.count))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(value, bound), code


@intrinsic
def filled(typing_context: Any, like: Any, scalar: Any) -> Any:
    """Return a vector of the kind of ``like`` with the same scalar in every entry."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _splat(builder, args[1], args[0].type)

    return like(like, scalar), code


@intrinsic
def with_entry(typing_context: Any, value: Any, index: Any, scalar: Any) -> Any:
    """Return the vector with one entry replaced."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.insert_element(args[0], args[2], args[1])

    return value(value, types.intp, scalar), code


def _selected(relation: str) -> Callable[..., Any]:
    """Make the choice, entry by entry, between two operands; one may be a scalar."""

    @intrinsic
    def choice(typing_context: Any, a: Any, b: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            operands = _as_vectors(context, builder, signature, args)
            return builder.select(builder.fcmp_ordered(relation, *operands), *operands)

        return _vector_type((a, b))(a, b), code

    return choice


smaller = _selected("<")
larger = _selected(">")


@intrinsic
def two_to_rounded(typing_context: Any, shifted: Any) -> Any:
    """Return 2^k for vectors that hold `ROUNDING_SHIFT` + k, k a whole number.

    The low bits of such a number are k itself: shifted into the exponent, they make 2^k.
    """

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        vector = args[0].type
        bits = ir.VectorType(ir.IntType(64), vector.count)
        whole = builder.bitcast(args[0], bits)
        moved = builder.shl(whole, ir.Constant(bits, [52] * vector.count))
        one = ir.Constant(bits, [0x3FF0000000000000] * vector.count)
        return builder.bitcast(builder.add(moved, one), vector)

    return shifted(shifted), code


@intrinsic
def add_to(typing_context: Any, array: Any, index: Any, value: Any) -> Any:
    """Add a vector to an array."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array, index, value = args
        pointer = _pointer(context, builder, signature.args[0], array, index, value.type)
        total = builder.fadd(builder.load(pointer, align=_ALIGNED), value)
        builder.store(total, pointer, align=_ALIGNED)
        return context.get_dummy_value()

    return types.void(array, types.intp, value), code


@intrinsic
def where_below(typing_context: Any, value: Any, bound: Any, then: Any, otherwise: Any) -> Any:
    """Return, entry by entry, ``then`` where ``value`` is less than ``bound``, or ``otherwise``."""

    def code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        value, bound, *results = _as_vectors(context, builder, signature, args)
        return builder.select(builder.fcmp_ordered("<", value, bound), *results)

    kinds = (value, bound, then, otherwise)
    return _vector_type(kinds)(*kinds), code
