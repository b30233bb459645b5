# mypy: allow-untyped-defs, allow-untyped-decorators
"""Vectors of 16 float32 numbers for kernels. LLVM makes one or a few vector instructions of each operation on them.

numba vectorises loops, but it keeps no sums in registers from one turn of an outer loop to the next; these vectors do.
`lanes(number)`, `lane_numbers()` and `load` make them. They take +, +=, -, *, /, `min`, `max`, `where`, `total` and
`store`; <=, <, >= give masks, which take &. One of two operands may be a float32 number.
"""

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, models, register_model

NUM_LANES = 16

_INT32 = ir.IntType(32)
_FLOATS, _BITS = ir.VectorType(ir.FloatType(), NUM_LANES), ir.VectorType(ir.IntType(1), NUM_LANES)


class _Lanes(types.Type):
    """numba's type of a vector."""

    def __init__(self):
        super().__init__(name="Lanes")


class _Mask(types.Type):
    """numba's type of the results of comparisons."""

    def __init__(self):
        super().__init__(name="Mask")


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, numba_type):
        super().__init__(manager, numba_type, _FLOATS)


@register_model(_Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager, numba_type):
        super().__init__(manager, numba_type, _BITS)


_LANES, _MASK, _FLOAT = _Lanes(), _Mask(), types.float32
_WITH_NUMBERS = ((_LANES, _LANES), (_LANES, _FLOAT), (_FLOAT, _LANES))


def _define(function, result, emit, operands=_WITH_NUMBERS):
    """Let the function take two operands of these types; emit(builder, a, b) writes the instructions."""
    infer_global(function)(
        type("_OfLanes", (ConcreteTemplate,), {"cases": [signature(result, *pair) for pair in operands]})
    )

    def lower(context, builder, sig, arguments):
        return emit(builder, *(_vector(builder, argument) for argument in arguments))

    for pair in operands:
        lower_builtin(function, *pair)(lower)


_define(operator.add, _LANES, lambda builder, a, b: builder.fadd(a, b))
_define(operator.iadd, _LANES, lambda builder, a, b: builder.fadd(a, b))
_define(operator.sub, _LANES, lambda builder, a, b: builder.fsub(a, b))
_define(operator.mul, _LANES, lambda builder, a, b: builder.fmul(a, b))
_define(operator.truediv, _LANES, lambda builder, a, b: builder.fdiv(a, b))
_define(operator.le, _MASK, lambda builder, a, b: builder.fcmp_ordered("<=", a, b))
_define(operator.lt, _MASK, lambda builder, a, b: builder.fcmp_ordered("<", a, b))
_define(operator.ge, _MASK, lambda builder, a, b: builder.fcmp_ordered(">=", a, b))
_define(operator.and_, _MASK, lambda builder, a, b: builder.and_(a, b), operands=((_MASK, _MASK),))
_define(min, _LANES, lambda builder, a, b: builder.select(builder.fcmp_ordered("<", a, b), a, b))
_define(max, _LANES, lambda builder, a, b: builder.select(builder.fcmp_ordered(">", a, b), a, b))


def _instruction(function: Callable[..., Any]) -> Any:
    """Decorator: kernels call this function without its first argument; it returns a signature and what writes it."""
    return intrinsic(function)


@_instruction
def lanes(typing_context, number):
    """lanes(number): the float32 number in every lane."""
    return _LANES(_FLOAT), lambda context, builder, sig, arguments: _vector(builder, *arguments)


@_instruction
def lane_numbers(typing_context):
    """lane_numbers(): 0, 1, ... 15."""
    return _LANES(), lambda *unused: ir.Constant(_FLOATS, [float(lane) for lane in range(NUM_LANES)])


@_instruction
def where(typing_context, mask, yes, no):
    """where(mask, yes, no): the vector or number `yes` where the mask is true, `no` elsewhere."""

    def lower(context, builder, sig, arguments):
        return builder.select(arguments[0], *(_vector(builder, argument) for argument in arguments[1:]))

    return _LANES(mask, yes, no), lower


@_instruction
def load(typing_context, array, index):
    """load(array, index): 16 numbers of a contiguous float32 array, of which all must exist; this is not checked."""

    def lower(context, builder, sig, arguments):
        return builder.load(_pointer(context, builder, sig, arguments), align=4)

    return _LANES(array, types.uintp), lower


@_instruction
def store(typing_context, array, index, vector):
    """store(array, index, vector): write a vector to where `load` reads it."""

    def lower(context, builder, sig, arguments):
        builder.store(arguments[2], _pointer(context, builder, sig, arguments), align=4)
        return context.get_dummy_value()

    return types.void(array, types.uintp, _LANES), lower


@_instruction
def total(typing_context, vector):
    """total(vector): the sum of the lanes, by halves."""

    def lower(context, builder, sig, arguments):
        (partial,), width = arguments, NUM_LANES
        while width > 1:
            width //= 2
            low, high = (_shuffled(builder, partial, range(first, first + width)) for first in (0, width))
            partial = builder.fadd(low, high)
        return builder.extract_element(partial, _INT32(0))

    return _FLOAT(_LANES), lower


def _vector(builder, operand):
    """Return the vector, or the number in every lane."""
    if isinstance(operand.type, ir.VectorType):
        return operand
    first = builder.insert_element(ir.Constant(_FLOATS, ir.Undefined), operand, _INT32(0))
    return _shuffled(builder, first, [0] * NUM_LANES)


def _shuffled(builder, vector, places):
    """Return the lanes at the given places."""
    indices = ir.Constant(ir.VectorType(_INT32, len(places)), list(places))
    return builder.shuffle_vector(vector, ir.Constant(vector.type, ir.Undefined), indices)


def _pointer(context, builder, sig, arguments):
    """Return a pointer to the vector whose first number is array[index], where these are the first two arguments."""
    array = context.make_array(sig.args[0])(context, builder, arguments[0])
    return builder.bitcast(builder.gep(array.data, [arguments[1]]), _FLOATS.as_pointer())
