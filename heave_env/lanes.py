"""Rows of a block in explicit vectors: one number per environment, all lanes at once.

A `Block` is the memory of some environments side by side, rows x lanes. Read as `S[row]` it gives the row as
one value, `S[row] = value` writes it; what a stage computes between the two it computes for all lanes. In a
block of one lane the same lines mean plain numbers, so that the kernel of a single environment is the plain
twin of every batch. `lane_of` looks at one lane of a wide block in that way, for what is seldom done.

The values take + - * / and comparisons (which give masks, joined by & | ^), `negated`, `where`, `minimum`,
`maximum`, `absolute`, `square_root`, `floor`, and `fused` for a x + b with one rounding. Each lane meets the
IEEE operation itself, never reassociated, whatever the number of lanes: that makes single and batch equal to
the last bit. Beside floats there are unsigned words of 64 and 32 bits, for random numbers.

Compilers make vectors of loops when they can prove that it is safe; here they are LLVM vectors by
construction. Blocks made `plain` compute the same in loops over the lanes: tests hold one to the other.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types
from numba.core import cgutils
from numba.core.cgutils import ir
from numba.core.datamodel import PrimitiveModel, register_default
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin

Array = np.ndarray

ALIGNMENT = 64
"""Bytes on which buffers of blocks begin: a cache line, and the widest register."""


class Lanes(types.Type):
    """The numba type of a row of numbers, one per lane; of booleans, a mask."""

    def __init__(self, dtype: types.Type, n_lanes: int, plain: bool) -> None:
        self.dtype, self.n_lanes, self.plain = dtype, n_lanes, plain
        super().__init__(name=f"Lanes({dtype}, {n_lanes}{', plain' if plain else ''})")


class Block(types.Type):
    """The numba type of a block: a pointer to its first row; rows lie `stride` numbers apart."""

    def __init__(self, dtype: types.Type, n_lanes: int, stride: int, plain: bool) -> None:
        self.dtype, self.n_lanes, self.stride, self.plain = dtype, n_lanes, stride, plain
        super().__init__(name=f"Block({dtype}, {n_lanes}, {stride}{', plain' if plain else ''})")


_MACHINE = {
    types.float32: ir.FloatType(),
    types.float64: ir.DoubleType(),
    types.uint64: ir.IntType(64),
    types.uint32: ir.IntType(32),
    types.int64: ir.IntType(64),
    types.boolean: ir.IntType(1),
}


@register_default(Lanes)
class _LanesModel(PrimitiveModel):
    def __init__(self, manager: Any, kind: Lanes) -> None:
        super().__init__(manager, kind, ir.VectorType(_MACHINE[kind.dtype], kind.n_lanes))


@register_default(Block)
class _BlockModel(PrimitiveModel):
    def __init__(self, manager: Any, kind: Block) -> None:
        super().__init__(manager, kind, _MACHINE[kind.dtype].as_pointer())


def _row_type(block: Block) -> types.Type:
    return _values(block, block.dtype)


def _values(like: types.Type, dtype: types.Type) -> types.Type:
    """The type of values of `dtype` in as many lanes as a block, lanes or a plain number has."""
    n_lanes = getattr(like, "n_lanes", 1)
    if not isinstance(like, Lanes) and n_lanes == 1:
        return dtype
    return Lanes(dtype, n_lanes, like.plain)


def _number_type(like: types.Type) -> types.Type:
    return getattr(like, "dtype", like)


def _machine_type(kind: types.Type) -> ir.Type:
    if isinstance(kind, Lanes):
        return ir.VectorType(_MACHINE[kind.dtype], kind.n_lanes)
    return _MACHINE[kind]


def _same_in_all(builder: Any, kind: types.Type, number: Any) -> Any:
    if not isinstance(kind, Lanes):
        return number
    vector = _machine_type(kind)
    if isinstance(number, ir.Constant):
        return ir.Constant(vector, [number.constant] * kind.n_lanes)
    one = builder.insert_element(ir.Constant(vector, ir.Undefined), number, ir.Constant(ir.IntType(32), 0))
    places = ir.Constant(ir.VectorType(ir.IntType(32), kind.n_lanes), [0] * kind.n_lanes)
    return builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), places)


def _each(builder: Any, kind: types.Type, operation: Callable[..., Any], *values: Any) -> Any:
    """Applies an operation of the builder; lane by lane in a loop if the values are plain lanes."""
    if not (isinstance(kind, Lanes) and kind.plain):
        return operation(builder, *values)
    made = cgutils.alloca_once_value(builder, ir.Constant(_machine_type(kind), ir.Undefined))
    with cgutils.for_range(builder, ir.Constant(ir.IntType(64), kind.n_lanes)) as loop:
        number = operation(builder, *[builder.extract_element(value, loop.index) for value in values])
        builder.store(builder.insert_element(builder.load(made), number, loop.index), made)
    return builder.load(made)


def _machine_call(name: str) -> Callable[..., Any]:
    """An operation that is one of LLVM's intrinsic functions."""

    def call(builder: Any, *values: Any) -> Any:
        kind = values[0].type
        suffix = {"float": "f32", "double": "f64"}[str(getattr(kind, "element", kind))]
        suffix = f"v{kind.count}{suffix}" if isinstance(kind, ir.VectorType) else suffix
        function = ir.FunctionType(kind, [kind] * len(values))
        declared = cgutils.get_or_insert_function(builder.module, function, f"{name}.{suffix}")
        return builder.call(declared, values)

    return call


_WORDS = (types.uint64, types.uint32)

# Operators -------------------------------------------------------------------------------------------


def _is_float(kind: types.Type) -> bool:
    return _number_type(kind) in (types.float32, types.float64)


def _add_operator(symbol: Any, typed: Callable[[Lanes], Lanes | None], made: Callable[[Lanes], Any]) -> None:
    """Teaches numba an operator on lanes: type of the result, and the operation by type of the operands."""

    @infer_global(symbol)
    class _Typing(AbstractTemplate):
        def generic(self, operands: Any, keywords: Any) -> Any:
            first = operands[0]
            if not isinstance(first, Lanes) or any(operand != first for operand in operands):
                return None
            result = typed(first)
            return None if result is None else signature(result, *operands)

    def generate(context: Any, builder: Any, called: Any, values: Any) -> Any:
        return _each(builder, called.return_type, made(called.args[0]), *values)

    n_operands = 1 if symbol is operator.neg else 2
    lower_builtin(symbol, *[Lanes] * n_operands)(generate)


def _arithmetic(symbol: Any, of_floats: str | None, of_words: str | None) -> None:
    def typed(kind: Lanes) -> Lanes | None:
        name = of_floats if _is_float(kind) else of_words if kind.dtype in _WORDS else None
        return None if name is None else kind

    def made(kind: Lanes) -> Any:
        name = str(of_floats if _is_float(kind) else of_words)
        return lambda builder, *values: getattr(builder, name)(*values)

    _add_operator(symbol, typed, made)


_arithmetic(operator.add, "fadd", "add")
_arithmetic(operator.sub, "fsub", "sub")
_arithmetic(operator.mul, "fmul", "mul")
_arithmetic(operator.truediv, "fdiv", None)
_arithmetic(operator.neg, "fneg", None)
_arithmetic(operator.lshift, None, "shl")
_arithmetic(operator.rshift, None, "lshr")


def _of_bits(symbol: Any, name: str) -> None:
    """Operators of words and masks."""
    _add_operator(
        symbol,
        lambda kind: None if _is_float(kind) else kind,
        lambda kind: lambda builder, *values: getattr(builder, name)(*values),
    )


_of_bits(operator.and_, "and_")
_of_bits(operator.or_, "or_")
_of_bits(operator.xor, "xor")


def _comparison(symbol: Any, sign: str) -> None:
    def made(kind: Lanes) -> Any:
        if _is_float(kind):
            # As of plain numbers: a NaN differs from everything and is neither less nor more.
            name = "fcmp_unordered" if sign == "!=" else "fcmp_ordered"
            return lambda builder, a, b: getattr(builder, name)(sign, a, b)
        return lambda builder, a, b: builder.icmp_unsigned(sign, a, b)

    def typed(kind: Lanes) -> Lanes | None:
        return None if kind.dtype == types.boolean else Lanes(types.boolean, kind.n_lanes, kind.plain)

    _add_operator(symbol, typed, made)


for _symbol, _sign in (
    (operator.lt, "<"),
    (operator.le, "<="),
    (operator.gt, ">"),
    (operator.ge, ">="),
    (operator.eq, "=="),
    (operator.ne, "!="),
):
    _comparison(_symbol, _sign)


# Rows ------------------------------------------------------------------------------------------------


@infer_global(operator.getitem)
class _ReadsRow(AbstractTemplate):
    def generic(self, arguments: Any, keywords: Any) -> Any:
        block, row = arguments
        if isinstance(block, Block) and isinstance(row, types.Integer):
            return signature(_row_type(block), block, types.intp)
        return None


@infer_global(operator.setitem)
class _WritesRow(AbstractTemplate):
    def generic(self, arguments: Any, keywords: Any) -> Any:
        block, row, value = arguments
        if isinstance(block, Block) and isinstance(row, types.Integer) and value == _row_type(block):
            return signature(types.none, block, types.intp, value)
        return None


def _place(builder: Any, kind: Block, block: Any, row: Any) -> Any:
    start = builder.mul(row, ir.Constant(row.type, kind.stride), flags=("nsw",))
    number = builder.gep(block, [start], inbounds=True)
    return builder.bitcast(number, _machine_type(_row_type(kind)).as_pointer())


def _alignment(context: Any, kind: Block) -> int:
    """Bytes on which a row lies: `ALIGNMENT`, unless it is narrower or part of a wider one."""
    size = context.get_abi_sizeof(_MACHINE[kind.dtype])
    whole = kind.n_lanes * size
    return min(ALIGNMENT, whole & -whole) if kind.n_lanes == kind.stride else size


@lower_builtin(operator.getitem, Block, types.intp)
def _read_row(context, builder, called, values):
    kind = called.args[0]
    return builder.load(_place(builder, kind, *values), align=_alignment(context, kind))


@lower_builtin(operator.setitem, Block, types.intp, types.Any)
def _write_row(context, builder, called, values):
    kind = called.args[0]
    block, row, value = values
    builder.store(value, _place(builder, kind, block, row), align=_alignment(context, kind))
    return context.get_dummy_value()


def _literal(kind: types.Type) -> int | None:
    return kind.literal_value if isinstance(kind, types.IntegerLiteral) else None


@intrinsic(prefer_literal=True)
def block_at(typing_context, address, single, n_lanes, plain):
    """The block of `n_lanes` lanes at an address; of float32 if `single` is 1, else of float64.

    All but the address are constants of the compilation.
    """
    if None in (_literal(single), _literal(n_lanes), _literal(plain)):
        return None
    dtype = types.float32 if _literal(single) else types.float64
    return _block_from_address(dtype, n_lanes, bool(_literal(plain)), (address, single, n_lanes, plain))


@intrinsic(prefer_literal=True)
def words_at(typing_context, address, n_lanes, plain):
    """The block of unsigned 64-bit words, otherwise as `block_at`."""
    if None in (_literal(n_lanes), _literal(plain)):
        return None
    return _block_from_address(types.uint64, n_lanes, bool(_literal(plain)), (address, n_lanes, plain))


@intrinsic
def integers_at(typing_context, address):
    """Integers at an address, one after the other."""
    return _block_from_address(types.int64, types.literal(1), False, (address,))


def _block_from_address(dtype, n_lanes, plain, arguments):
    width: Any = _literal(n_lanes)
    block = Block(dtype, width, width, plain)

    def generate(context, builder, called, values):
        address = context.cast(builder, values[0], called.args[0], types.intp)
        return builder.inttoptr(address, _MACHINE[dtype].as_pointer())

    return block(*arguments), generate


def _begin_at_lane(context, builder, called, values):
    lane = context.cast(builder, values[1], called.args[1], types.intp)
    return builder.gep(values[0], [lane], inbounds=True)


@intrinsic
def lane_of(typing_context, block, lane):
    """One lane of a block as a block of its own, whose rows are plain numbers."""
    if not isinstance(block, Block):
        return None
    return Block(block.dtype, 1, block.stride, block.plain)(block, lane), _begin_at_lane


@intrinsic(prefer_literal=True)
def lanes_of(typing_context, block, first, n_lanes):
    """Some lanes of a block, from `first` on, as a block of their own; `n_lanes` is a constant."""
    width = _literal(n_lanes)
    if not isinstance(block, Block) or width is None:
        return None
    part = Block(block.dtype, width, block.stride, block.plain)
    return part(block, first, n_lanes), _begin_at_lane


@intrinsic
def numbers_from(typing_context, block, row):
    """The memory of a block from a row on as plain numbers, one after the other."""
    if not isinstance(block, Block):
        return None

    def generate(context, builder, called, values):
        start = builder.mul(
            context.cast(builder, values[1], called.args[1], types.intp),
            ir.Constant(ir.IntType(64), block.stride),
        )
        return builder.gep(values[0], [start], inbounds=True)

    return Block(block.dtype, 1, 1, block.plain)(block, row), generate


# Functions of values ---------------------------------------------------------------------------------


@intrinsic
def constant(typing_context, like, number):
    """A number in the precision and lanes of `like`: a block, lanes or a plain number."""
    dtype = _number_type(like)
    kind = _values(like, dtype)

    def generate(context, builder, called, values):
        value = context.cast(builder, values[1], called.args[1], dtype)
        return _same_in_all(builder, kind, value)

    return kind(like, number), generate


@intrinsic
def converted(typing_context, like, values):
    """Floats in the precision of `like`, in the lanes they come in."""
    dtype = _number_type(like)
    if not _is_float(dtype) or not _is_float(values):
        return None
    kind = _values(values, dtype)

    def generate(context, builder, called, given):
        wider = _number_type(values) == types.float32

        def of_each(build: Any, number: Any) -> Any:
            many = isinstance(number.type, ir.VectorType)
            wanted = ir.VectorType(_MACHINE[dtype], number.type.count) if many else _MACHINE[dtype]
            if wanted == number.type:
                return number
            return build.fpext(number, wanted) if wider else build.fptrunc(number, wanted)

        return _each(builder, kind, of_each, given[1])

    return kind(like, values), generate


@intrinsic
def n_lanes_of(typing_context, block):
    """Lanes of a block; known to the compiler."""
    if not isinstance(block, Block):
        return None

    def generate(context, builder, called, values):
        return context.get_constant(types.intp, block.n_lanes)

    return types.intp(block), generate


def _function(operation: Callable[..., Any], *kinds: types.Type) -> Any:
    """Types and generates a function of floats of one kind, lanes or plain, that gives another of them."""
    first = kinds[0]
    if not _is_float(first) or any(kind != first for kind in kinds):
        return None

    def generate(context: Any, builder: Any, called: Any, values: Any) -> Any:
        return _each(builder, called.return_type, operation, *values)

    return first(*kinds), generate


@intrinsic
def fused(typing_context, a, b, c):
    """a b + c, rounded once."""
    return _function(_machine_call("llvm.fma"), a, b, c)


@intrinsic
def square_root(typing_context, a):
    """The square root."""
    return _function(_machine_call("llvm.sqrt"), a)


@intrinsic
def floor(typing_context, a):
    """The next whole number below."""
    return _function(_machine_call("llvm.floor"), a)


@intrinsic
def absolute(typing_context, a):
    """The number without its sign."""
    return _function(_machine_call("llvm.fabs"), a)


@intrinsic
def minimum(typing_context, a, b):
    """The less of two; the second if either is no number."""
    return _function(lambda build, x, y: build.select(build.fcmp_ordered("<", x, y), x, y), a, b)


@intrinsic
def maximum(typing_context, a, b):
    """The greater of two; the second if either is no number."""
    return _function(lambda build, x, y: build.select(build.fcmp_ordered(">", x, y), x, y), a, b)


@intrinsic
def where(typing_context, mask, a, b):
    """a where the mask is set, else b."""
    if a != b or mask != _values(a, types.boolean):
        return None

    def generate(context, builder, called, values):
        return _each(builder, called.return_type, lambda build, *parts: build.select(*parts), *values)

    return a(mask, a, b), generate


@intrinsic
def negated(typing_context, mask):
    """The mask that is set where this one is not."""
    if _number_type(mask) != types.boolean:
        return None

    def generate(context, builder, called, values):
        return _each(builder, mask, lambda build, value: build.not_(value), *values)

    return mask(mask), generate


@intrinsic
def any_of(typing_context, mask):
    """Whether the mask is set in any lane."""
    if _number_type(mask) != types.boolean:
        return None

    def generate(context, builder, called, values):
        if not isinstance(mask, Lanes):
            return values[0]
        bits = builder.bitcast(values[0], ir.IntType(mask.n_lanes))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(mask), generate


# Words and floats ------------------------------------------------------------------------------------


def _to_float(like: types.Type, words: types.Type, operation: Callable[..., Any]) -> Any:
    """Types and generates a conversion of words to floats of the precision of `like`."""
    dtype = _number_type(like)
    if _number_type(words) not in _WORDS or not _is_float(dtype):
        return None
    kind = _values(words, dtype)

    def generate(context: Any, builder: Any, called: Any, values: Any) -> Any:
        def of_each(build: Any, word: Any) -> Any:
            many = isinstance(word.type, ir.VectorType)

            def shaped(element: ir.Type) -> ir.Type:
                return ir.VectorType(element, word.type.count) if many else element

            half = shaped(ir.IntType(32))
            low = word if word.type == half else build.trunc(word, half)
            return operation(build, low, shaped(_MACHINE[dtype]))

        return _each(builder, kind, of_each, values[1])

    return kind(like, words), generate


@intrinsic
def low_halves(typing_context, words):
    """The low 32 bits of words: lanes of 32 bits, or of a plain word a plain word."""
    if _number_type(words) != types.uint64:
        return None
    kind = Lanes(types.uint32, words.n_lanes, words.plain) if isinstance(words, Lanes) else words

    def generate(context, builder, called, values):
        if kind == words:
            return builder.and_(values[0], ir.Constant(ir.IntType(64), 0xFFFFFFFF))
        return builder.trunc(values[0], _machine_type(kind))

    return kind(words), generate


@intrinsic
def unsigned_float(typing_context, like, words):
    """The float of the low 32 bits of words, taken as a number from 0 on, in the precision of `like`."""
    return _to_float(like, words, lambda build, low, real: build.uitofp(low, real))


@intrinsic
def signed_float(typing_context, like, words):
    """The float of the low 32 bits of words, taken as two's complement, in the precision of `like`."""
    return _to_float(like, words, lambda build, low, real: build.sitofp(low, real))


def _of_parts(a: types.Type, operation: Callable[..., Any]) -> Any:
    """Types and generates a function of the bits of normal floats."""
    if not _is_float(a):
        return None
    width, shift, bias = (32, 23, 127) if _number_type(a) == types.float32 else (64, 52, 1023)

    def generate(context: Any, builder: Any, called: Any, values: Any) -> Any:
        def of_each(build: Any, number: Any) -> Any:
            kind = number.type
            many = isinstance(kind, ir.VectorType)
            whole = ir.VectorType(ir.IntType(width), kind.count) if many else ir.IntType(width)

            def bits(value: int) -> Any:
                return ir.Constant(whole, [value] * kind.count if many else value)

            return operation(build, build.bitcast(number, whole), bits, kind, shift, bias)

        return _each(builder, a, of_each, *values)

    return a(a), generate


@intrinsic
def exponent_of(typing_context, a):
    """The power of two that is the exponent of a positive normal float, as a float."""
    return _of_parts(
        a,
        lambda build, given, bits, kind, shift, bias: build.sitofp(
            build.sub(build.lshr(given, bits(shift)), bits(bias)), kind
        ),
    )


@intrinsic
def mantissa_of(typing_context, a):
    """A positive normal float over its power of two, in [1, 2)."""
    return _of_parts(
        a,
        lambda build, given, bits, kind, shift, bias: build.bitcast(
            build.or_(build.and_(given, bits((1 << shift) - 1)), bits(bias << shift)), kind
        ),
    )


@intrinsic
def is_single(typing_context, like):
    """Whether the precision is float32; known to the compiler."""
    single = _number_type(like) == types.float32

    def generate(context, builder, called, values):
        return context.get_constant(types.boolean, single)

    return types.boolean(like), generate


@intrinsic(prefer_literal=True)
def counting(typing_context, n_lanes):
    """0, 1, 2, ... in `n_lanes` lanes of words."""
    width = _literal(n_lanes)
    if width is None:
        return None
    kind = Lanes(types.uint64, width, False)

    def generate(context, builder, called, values):
        return ir.Constant(_machine_type(kind), list(range(kind.n_lanes)))

    return kind(n_lanes), generate


@intrinsic
def lane(typing_context, values, number):
    """The plain number in one lane."""
    if not isinstance(values, Lanes):
        return None

    def generate(context, builder, called, given):
        place = context.cast(builder, given[1], called.args[1], types.int64)
        return builder.extract_element(given[0], place)

    return values.dtype(values, number), generate


@intrinsic
def pair(typing_context, first, second):
    """Two plain numbers in two lanes."""
    if first != second or not _is_float(first) or isinstance(first, Lanes):
        return None
    kind = Lanes(first, 2, False)

    def generate(context, builder, called, given):
        made = ir.Constant(_machine_type(kind), ir.Undefined)
        for i, number in enumerate(given):
            made = builder.insert_element(made, number, ir.Constant(ir.IntType(32), i))
        return made

    return kind(first, second), generate


@intrinsic
def swapped(typing_context, values):
    """Two lanes in the other order."""
    if not isinstance(values, Lanes) or values.n_lanes != 2:
        return None

    def generate(context, builder, called, given):
        places = ir.Constant(ir.VectorType(ir.IntType(32), 2), [1, 0])
        return builder.shuffle_vector(given[0], given[0], places)

    return values(values), generate


@intrinsic
def store_across(typing_context, numbers, first, stride, a, b, c, d):
    """Stores four values of float32 lane by lane: those of a lane side by side, from `numbers[first]` on,
    those of the next `stride` further on."""
    if not (isinstance(numbers, Block) and isinstance(a, Lanes) and a.dtype == types.float32):
        return None
    if any(other != a for other in (b, c, d)):
        return None

    def generate(context, builder, called, values):
        place = context.cast(builder, values[1], called.args[1], types.intp)
        apart = context.cast(builder, values[2], called.args[2], types.intp)
        n_lanes, whole = a.n_lanes, ir.IntType(32)

        def places(numbers: list[int]) -> Any:
            return ir.Constant(ir.VectorType(whole, len(numbers)), numbers)

        in_turn = [i + n_lanes * side for i in range(n_lanes) for side in (0, 1)]
        pairs = [builder.shuffle_vector(*values[i : i + 2], places(in_turn)) for i in (3, 5)]
        four = ir.VectorType(_MACHINE[types.float32], 4).as_pointer()
        for i in range(n_lanes):
            chosen = [2 * i, 2 * i + 1, 2 * n_lanes + 2 * i, 2 * n_lanes + 2 * i + 1]
            beside = builder.shuffle_vector(*pairs, places(chosen))
            target = builder.bitcast(builder.gep(values[0], [place], inbounds=True), four)
            builder.store(beside, target, align=4)
            place = builder.add(place, apart, flags=("nsw",))
        return context.get_dummy_value()

    return types.none(numbers, first, stride, a, b, c, d), generate


@intrinsic
def align_stack(typing_context):
    """Has the function that it stands in keep its stack on cache lines.

    LLVM aligns the stack only where it sees need before it gives out registers; vectors that find no
    register are then stored across two lines each, which costs more than all they compute. An aligned
    number that seems to be used is need enough.
    """

    def generate(context, builder, called, values):
        number = cgutils.alloca_once(builder, ir.IntType(64))
        number.align = ALIGNMENT
        seen = ir.FunctionType(ir.VoidType(), [number.type])
        builder.asm(seen, "", "r", [number], side_effect=True)
        return context.get_dummy_value()

    return types.none(), generate


def aligned_zeros(shape: tuple[int, ...], dtype: Any) -> Array:
    """Zeros in memory that begins at a multiple of `ALIGNMENT` bytes, so that rows do not straddle lines."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    memory = np.zeros(size + ALIGNMENT, dtype=np.uint8)
    start = -memory.ctypes.data % ALIGNMENT
    return memory[start : start + size].view(dtype).reshape(shape)
