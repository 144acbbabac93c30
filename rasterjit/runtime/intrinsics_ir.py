"""
Generate the LLVM IR of the intrinsics. Imported when something compiles.

The problem: LLVM turns loops into vector instructions by itself, if it can prove that this changes
nothing. Of the inner loops of a rasterizer it rarely can: which samples a row of a triangle covers
depends on the data, and it must not touch the others. What it makes of them also differs from CPU
to CPU, and from version to version.

The idea: the few loops in which a frame spends its time are written here as instructions for
``LANES`` neighbouring samples, so many on every CPU. LLVM has vectors of any length as types: on a
CPU with narrower registers it splits them, and each lane computes what scalar code would. So the
bits are the same everywhere. In Python (``intrinsics.py``) each has a twin of a few lines that says
what it does; kernels call it by that name, and run it where nothing is compiled.

How to read it. An ``@intrinsic`` is called twice. First with Numba's *types* of its arguments: it
returns a signature, and the function ``generate``. That is called with LLVM's *values* of the
arguments, and a ``builder``: each of its methods appends one instruction to the kernel that is
being compiled, and returns the value that the instruction will have. Nothing is computed here.

An example: ``spread(row, start, value)`` writes a number to ``LANES`` places of a row. ::

    filled = _broadcast(builder, number, LANES)         # a vector of 8 equal lanes
    pointer = builder.gep(data, [index])                # &row[start]
    builder.store(filled, bitcast(pointer), align=4)    # one store, at any address

becomes, for float32 and AVX2, ``vbroadcastss ymm0, xmm0`` and ``vmovups [rdi], ymm0``; two stores
of 16 bytes for older CPUs and for ARM.

Words of this file: ``_broadcast`` copies a value to all lanes; ``_arithmetic_lanes`` counts up from
one by a step, lane by lane; ``_loop`` hands values from iteration to iteration, as LLVM has no
variables that change; ``load_field`` and ``list_axis_values`` read the record behind an array; a
*mask* is a vector of bits that says which lanes count. ``_Tile`` writes under one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from rasterjit.runtime.array_type import (
    WORD,
    PlainArray,
    list_axis_values,
    load_field,
    make_array,
    pack_words,
)
from rasterjit.runtime.intrinsics import (
    CHANNELS,
    LANES,
    CodedTexels,
)
from rasterjit.runtime.jit import CHECKED
from rasterjit.runtime.targets import current_target

LANE = ir.IntType(32)
"""Type of integer lanes, and of the index of a lane."""

SAMPLES_AHEAD = 32
"""How many samples ahead texels are prefetched."""


def _broadcast(builder: Any, value: Any, lanes: int) -> Any:
    """Return a vector of a value in every lane."""
    undefined = ir.Constant(ir.VectorType(value.type, lanes), ir.Undefined)
    first = builder.insert_element(undefined, value, LANE(0))
    return builder.shuffle_vector(
        first, undefined, ir.Constant(ir.VectorType(LANE, lanes), [0] * lanes)
    )


@intrinsic
def spread(typing_context: Any, row: Any, start: Any, value: Any) -> Any:
    """Write a value to ``LANES`` neighbouring places of a contiguous row, from ``start`` on."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, index, number = arguments
        filled = _broadcast(builder, number, LANES)
        place = builder.gep(load_field(context, builder, row, array, "data"), [index])
        size = number.type.get_abi_size(context.target_data)
        builder.store(filled, builder.bitcast(place, filled.type.as_pointer()), align=size)
        return context.get_dummy_value()

    return types.void(row, types.uintp, row.dtype), generate


@intrinsic
def part(typing_context: Any, rows: Any, number: Any, start: Any, stop: Any) -> Any:
    """Return the places ``start:stop`` of a row of a contiguous array, without a copy."""
    if rows.layout != "C" or rows.ndim != 2:
        raise TypeError(f"a row is part of a contiguous array of two axes, not of {rows}")
    row = rows.copy(ndim=1)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, index, first, end = arguments
        count, length = list_axis_values(context, builder, rows, array, "shape")
        if CHECKED:
            order = ((index, count, "<"), (first, end, "<="), (end, length, "<="))
            for low, high, comparison in order:
                # Unsigned, so that what is below zero is beyond the end.
                is_outside = builder.not_(builder.icmp_unsigned(comparison, low, high))
                with builder.if_then(is_outside, likely=False):
                    message = "a part of a row ends beyond the row"
                    context.call_conv.return_user_exc(builder, IndexError, (message,))
        start = builder.add(builder.mul(index, length), first)
        return _make_row(context, builder, row, rows, array, start, builder.sub(end, first))

    return row(rows, types.intp, types.intp, types.intp), generate


def _make_row(
    context: Any, builder: Any, kind: Any, whole: Any, array: Any, start: Any, count: Any
) -> Any:
    """Return ``count`` elements of a contiguous array as a row."""
    data = load_field(context, builder, whole, array, "data")
    data = data if start is None else builder.gep(data, [start])
    if isinstance(kind, PlainArray):
        return make_array(context, builder, kind, data, [count], [])
    # A helper that Python calls takes Numba's own arrays.
    row = context.make_array(kind)(context, builder)
    source = context.make_array(whole)(context, builder, array)
    row.meminfo, row.parent, row.itemsize = source.meminfo, source.parent, source.itemsize
    row.nitems, row.data = count, data
    row.shape = pack_words(builder, [count])
    row.strides = pack_words(builder, [source.itemsize])
    return row._getvalue()


def _interpolate(builder: Any, one: Any, other: Any, share: Any) -> Any:
    """Return ``one + share * (other - one)`` in each channel."""
    shares = _broadcast(builder, share, CHANNELS)
    return builder.fadd(one, builder.fmul(shares, builder.fsub(other, one)))


def _element(context: Any, builder: Any, kind: Any, rows: Any, row: int, n: Any) -> Any:
    """Return a pointer to element ``n`` of a row, of a tuple of contiguous rows."""
    data = load_field(context, builder, kind[row], builder.extract_value(rows, row), "data")
    return builder.gep(data, [n])


def _texel_at(context: Any, builder: Any, kind: Any, array: Any, first: Any, number: Any) -> Any:
    """Return a pointer to the channels of a texel, given in `HALVES` from a first one."""
    data = load_field(context, builder, kind, array, "data")
    data = builder.gep(data, [builder.mul(first, first.type(CHANNELS))])
    halves = builder.bitcast(data, ir.IntType(64).as_pointer())
    place = builder.gep(halves, [builder.sext(number, first.type)])
    return builder.bitcast(place, ir.VectorType(ir.FloatType(), CHANNELS).as_pointer())


def _texel(context: Any, builder: Any, *arguments: Any) -> Any:
    """Load the channels of a texel; takes what `_texel_at` does."""
    return builder.load(_texel_at(context, builder, *arguments), align=4)


def _store_channels(
    context: Any, builder: Any, kind: Any, rows: Any, n: Any, colors: list[Any]
) -> Any:
    """Store the colours of ``CHANNELS`` neighbouring samples channel by channel."""

    def pick(one: Any, other: Any, lanes: tuple[int, ...]) -> Any:
        mask = ir.Constant(ir.VectorType(LANE, CHANNELS), list(lanes))
        return builder.shuffle_vector(one, other, mask)

    # Transpose in two steps: pairs of samples, then pairs of pairs.
    a, b, c, d = colors
    low, high = (0, 4, 1, 5), (2, 6, 3, 7)
    first, second = (0, 1, 4, 5), (2, 3, 6, 7)
    red_green, others = (pick(a, b, low), pick(c, d, low)), (pick(a, b, high), pick(c, d, high))
    channels = [pick(*pair, lanes) for pair in (red_green, others) for lanes in (first, second)]
    for k, channel in enumerate(channels):
        place = _element(context, builder, kind, rows, k, n)
        builder.store(channel, builder.bitcast(place, channel.type.as_pointer()), align=4)
    return context.get_dummy_value()


def _prefetch(builder: Any, place: Any) -> None:
    """Prefetch the cache line at a pointer."""
    byte = ir.IntType(8).as_pointer()
    kind = ir.FunctionType(ir.VoidType(), [byte, LANE, LANE, LANE])
    prefetch = builder.module.declare_intrinsic("llvm.prefetch", [byte], kind)
    # To be read, kept in all caches, data.
    builder.call(prefetch, [builder.bitcast(place, byte), LANE(0), LANE(3), LANE(1)])


def _prefetch_ahead(context: Any, builder: Any, signature: Any, arguments: Any) -> None:
    """Prefetch the left texels of samples further on; right neighbours mostly share their line."""
    texels, _, corners = signature.args[:3]
    array, base, places, *_, start = arguments
    rows = [builder.extract_value(places, row) for row in (0, 2)]
    length = list_axis_values(context, builder, corners[0], rows[0], "shape")[0]
    last, ahead = (
        builder.sub(length, length.type(CHANNELS)),
        builder.add(start, start.type(SAMPLES_AHEAD)),
    )
    ahead = builder.select(builder.icmp_signed("<", ahead, last), ahead, last)
    for k in range(CHANNELS):
        for row in (0, 2):
            at = builder.add(ahead, ahead.type(k))
            number = builder.load(_element(context, builder, corners, places, row, at))
            _prefetch(builder, _texel_at(context, builder, texels, array, base, number))


def _decoded_texel(context: Any, builder: Any, kind: Any, coded: Any, number: Any) -> Any:
    """Return the channels of a coded texel, given in `HALVES`."""
    codes, first, step, others, curves, curve, alphas, _ = (
        builder.extract_value(coded, k) for k in range(len(CodedTexels._fields))
    )
    codes = load_field(context, builder, kind[0], codes, "data")
    curves = load_field(context, builder, kind[4], curves, "data")
    texel = builder.sext(builder.ashr(number, LANE(1)), step.type)
    red = builder.add(first, builder.mul(texel, step))
    found = ir.Constant(ir.VectorType(ir.FloatType(), CHANNELS), ir.Undefined)
    for k in range(CHANNELS):
        place = builder.add(red, builder.extract_value(others, k - 1)) if k else red
        code = builder.zext(builder.load(builder.gep(codes, [place])), step.type)
        entry = builder.add(curve if k < CHANNELS - 1 else alphas, code)
        value = builder.load(builder.gep(curves, [entry]))
        found = builder.insert_element(found, value, LANE(k))
    return found


def _read_texels(
    context: Any, builder: Any, kinds: Any, array: Any, base: Any, coded: Any, numbers: list[Any]
) -> list[Any]:
    """Load texels that are all coded or all floats, as the first of them is."""
    end = builder.extract_value(coded, len(CodedTexels._fields) - 1)
    is_code = builder.icmp_signed("<", builder.sext(numbers[0], end.type), end)
    with builder.if_else(is_code, likely=None) as (then, otherwise):
        with then:
            decoded = [_decoded_texel(context, builder, kinds[1], coded, n) for n in numbers]
            after_codes = builder.block
        with otherwise:
            loaded = [_texel(context, builder, kinds[0], array, base, n) for n in numbers]
            after_floats = builder.block
    found = []
    for code, value in zip(decoded, loaded, strict=True):
        texel = builder.phi(value.type)
        texel.add_incoming(code, after_codes)
        texel.add_incoming(value, after_floats)
        found.append(texel)
    return found


@intrinsic
def copy_texels(
    typing_context: Any, texels: Any, first: Any, numbers: Any, coded: Any, colors: Any, n: Any
) -> Any:
    """Copy ``CHANNELS`` texels, as `mix_texels` takes them, to places ``n`` ... of four rows."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, base, row, codes, target, start = arguments
        data, found = load_field(context, builder, numbers, row, "data"), []
        for k in range(CHANNELS):
            number = builder.load(builder.gep(data, [builder.add(start, start.type(k))]))
            found += _read_texels(context, builder, (texels, coded), array, base, codes, [number])
        return _store_channels(context, builder, colors, target, start, found)

    return types.void(texels, types.int64, numbers, coded, colors, types.int64), generate


@intrinsic
def mix_texels(
    typing_context: Any, texels: Any, first: Any, corners: Any, coded: Any, shares: Any,
    is_far: Any, colors: Any, n: Any,
) -> Any:  # fmt: skip
    """Mix texels for ``CHANNELS`` neighbouring samples."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, base, places, codes, weights, is_far, target, start = arguments
        with builder.if_then(context.is_true(builder, types.boolean, is_far)):
            _prefetch_ahead(context, builder, signature, arguments)
        found = []
        for k in range(CHANNELS):
            at = builder.add(start, start.type(k))
            along, upward = (
                builder.load(_element(context, builder, shares, weights, row, at))
                for row in range(2)
            )
            numbers = [
                builder.load(_element(context, builder, corners, places, row, at))
                for row in range(4)
            ]
            values = _read_texels(context, builder, (texels, coded), array, base, codes, numbers)
            lower = _interpolate(builder, values[0], values[1], along)
            upper = _interpolate(builder, values[2], values[3], along)
            found.append(_interpolate(builder, lower, upper, upward))
        return _store_channels(context, builder, colors, target, start, found)

    argument_types = texels, types.int64, corners, coded, shares, types.boolean, colors, types.int64
    return types.void(*argument_types), generate


# Rows of samples


def _lane_numbers(kind: Any, lanes: int) -> Any:
    """Return the vector 0, 1, 2 ... of a type."""
    number = int if isinstance(kind, ir.IntType) else float
    return ir.Constant(ir.VectorType(kind, lanes), [number(k) for k in range(lanes)])


def _add(builder: Any, value: Any, step: Any) -> Any:
    """Return the sum of two vectors, of integers or floats."""
    is_whole = isinstance(value.type.element, ir.IntType)
    return builder.add(value, step) if is_whole else builder.fadd(value, step)


def _arithmetic_lanes(builder: Any, value: Any, step: Any, lanes: int) -> Any:
    """Return a vector that starts at a value and grows by a step from lane to lane."""
    steps, numbers = _broadcast(builder, step, lanes), _lane_numbers(step.type, lanes)
    is_whole = isinstance(step.type, ir.IntType)
    gained = builder.mul(numbers, steps) if is_whole else builder.fmul(numbers, steps)
    return _add(builder, _broadcast(builder, value, lanes), gained)


def _loop(builder: Any, count: Any, values: list[Any], body: Callable) -> list[Any]:
    """Loop ``count`` times over ``values = body(number, values)``; return the last values."""
    before, head = builder.block, builder.append_basic_block("head")
    inside, after = builder.append_basic_block("body"), builder.append_basic_block("after")
    builder.branch(head)
    builder.position_at_end(head)
    running = [builder.phi(value.type) for value in (count, *values)]
    builder.cbranch(builder.icmp_signed("<", running[0], count), inside, after)
    builder.position_at_end(inside)
    following = body(running[0], running[1:])
    following = [builder.add(running[0], count.type(1)), *following]
    for phi, first, following_value in zip(
        running, [count.type(0), *values], following, strict=True
    ):
        phi.add_incoming(first, before)
        phi.add_incoming(following_value, builder.block)
    builder.branch(head)
    builder.position_at_end(after)
    return running[1:]


def _extract_elements(builder: Any, row: Any, count: int) -> list[Any]:
    return [builder.extract_value(row, k) for k in range(count)]


def _check_end(context: Any, builder: Any, end: Any, length: Any) -> None:
    """Raise IndexError if a row ends beyond its array, where indices are checked."""
    if CHECKED:
        is_beyond = builder.icmp_signed(">", end, length)
        with builder.if_then(is_beyond, likely=False):
            message = "a row of samples ends beyond its memory"
            context.call_conv.return_user_exc(builder, IndexError, (message,))


def _load_lanes(builder: Any, row: Any, place: Any, align: int) -> Any:
    """Load ``LANES`` elements of a row from a place on."""
    kind = ir.VectorType(row.type.pointee, LANES).as_pointer()
    return builder.load(builder.bitcast(builder.gep(row, [place]), kind), align=align)


@intrinsic
def interpolate_uv_run(
    typing_context: Any, u: Any, v: Any, count: Any, edges: Any, steps: Any, factors: Any,
    first: Any, differences: Any,
) -> Any:  # fmt: skip
    """Write the texture coordinates of neighbouring samples of one face, in float64."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        # Half a vector for a few samples would cost a wrong guess now and then.
        lanes, count = LANES, arguments[2]
        edge, step, factor, start, difference = (
            [
                _broadcast(builder, value, lanes)
                for value in _extract_elements(builder, row, kind.count)
            ]
            for row, kind in zip(arguments[3:], signature.args[3:], strict=True)
        )
        targets = [
            load_field(context, builder, signature.args[k], arguments[k], "data") for k in (0, 1)
        ]
        length = list_axis_values(context, builder, signature.args[0], arguments[0], "shape")[0]
        one = ir.Constant(edge[0].type, [1.0] * lanes)

        def draw_group(number: Any, values: list[Any]) -> list[Any]:
            place = builder.mul(number, number.type(lanes))
            _check_end(context, builder, builder.add(place, place.type(lanes)), length)
            parts = [
                builder.fmul(
                    builder.fadd(edge[k], builder.fmul(values[0], step[k])), factor[k]
                )
                for k in range(3)
            ]  # fmt: skip
            total = builder.fadd(builder.fadd(parts[0], parts[1]), parts[2])
            over = builder.fdiv(one, total)
            second, third = builder.fmul(parts[1], over), builder.fmul(parts[2], over)
            for k, target in enumerate(targets):
                moved = builder.fadd(start[k], builder.fmul(second, difference[k]))
                moved = builder.fadd(moved, builder.fmul(third, difference[2 + k]))
                to = builder.bitcast(builder.gep(target, [place]), moved.type.as_pointer())
                builder.store(moved, to, align=8)
            return [builder.fadd(values[0], ir.Constant(one.type, [float(lanes)] * lanes))]

        groups = builder.add(count, count.type(lanes - 1))
        groups = builder.lshr(groups, count.type(lanes.bit_length() - 1))
        _loop(builder, groups, [_lane_numbers(ir.DoubleType(), lanes)], draw_group)
        return context.get_dummy_value()

    three, two, four = (types.UniTuple(types.float64, size) for size in (3, 2, 4))
    return types.void(u, v, types.int64, three, three, three, two, four), generate


class _Tile:
    """A tile; tests vectors of neighbouring samples against its depths."""

    def __init__(self, context: Any, builder: Any, signature: Any, arguments: Any) -> None:
        self._context, self._builder = context, builder
        self._has_masks = "+avx512vl" in current_target().features
        self.stored = context.get_value_type(signature.args[0].dtype)
        self.size = self.stored.get_abi_size(context.target_data)
        self._depths, self._lane_numbers = (
            load_field(context, builder, signature.args[k], arguments[k], "data") for k in range(2)
        )
        self._length = list_axis_values(context, builder, signature.args[0], arguments[0], "shape")[
            0
        ]

    def check(self, end: Any) -> None:
        """Raise IndexError if samples lie beyond the end, where indices are checked."""
        _check_end(self._context, self._builder, end, self._length)

    def store_nearer(
        self, place: Any, is_inside: Any, depth: Any, limits: Any, face: Any, is_mixed: bool
    ) -> None:
        """
        Store the depths, clamped to limits, and the face where they are nearer than the tile's.

        Of equal depths the lower face wins: the first one, where faces are not mixed. All lanes are
        written, some unchanged: no other thread uses the tile.
        """
        builder, depth = self._builder, self.to_stored(depth, limits)
        stored = depth.type
        depths, numbers = (
            builder.bitcast(builder.gep(array, [place]), vector.as_pointer())
            for array, vector in ((self._depths, stored), (self._lane_numbers, face.type))
        )
        old = self._load(depths, self.size)
        if is_mixed:
            wins = self.wins_depth_test(
                is_inside, depth, old, face, lambda: builder.load(numbers, align=4)
            )
        else:
            wins = builder.and_(is_inside, self.compare(">", depth, old))
        builder.store(builder.select(wins, depth, old), depths, align=self.size)
        old_face = self._load(numbers, 4)
        builder.store(builder.select(wins, face, old_face), numbers, align=4)

    def scatter_nearer(
        self, places: list[Any], is_inside: Any, depth: Any, face: Any, is_mixed: Any
    ) -> None:
        """Store nearer depths, in stored form, and faces at separate places, last lane first."""
        builder = self._builder
        for place in places:
            self.check(builder.add(place, place.type(1)))
        old, pointers = [], []
        for array, kind in ((self._depths, depth.type), (self._lane_numbers, face.type)):
            pointers.append([builder.gep(array, [place]) for place in places])
            values = ir.Constant(kind, ir.Undefined)
            for k, pointer in enumerate(pointers[-1]):
                values = builder.insert_element(values, builder.load(pointer), LANE(k))
            old.append(values)
        wins = self.wins_depth_test(is_inside, depth, old[0], face, lambda: old[1], is_mixed)
        for addresses, new, before in zip(pointers, (depth, face), old, strict=True):
            values = builder.select(wins, new, before)
            for k in reversed(range(len(places))):
                builder.store(builder.extract_element(values, LANE(k)), addresses[k])

    def compare(self, operator: str, depth: Any, other: Any) -> Any:
        """Compare stored depths, lane by lane."""
        is_whole = isinstance(self.stored, ir.IntType)
        compare = self._builder.icmp_signed if is_whole else self._builder.fcmp_ordered
        return compare(operator, depth, other)

    def wins_depth_test(
        self, is_inside: Any, depth: Any, other: Any, face: Any, load_other: Callable,
        is_mixed: Any = None,
    ) -> Any:  # fmt: skip
        """
        Return which stored depths are nearer than others, or as near and of a lower face, if mixed.

        Ties are rare: a branch skips the comparison of faces.
        """
        builder = self._builder
        is_nearer = builder.and_(is_inside, self.compare(">", depth, other))
        is_tied = builder.and_(is_inside, self.compare("==", depth, other))
        lanes = ir.IntType(is_tied.type.count)
        has_tie = builder.icmp_unsigned("!=", builder.bitcast(is_tied, lanes), lanes(0))
        has_tie = has_tie if is_mixed is None else builder.and_(has_tie, is_mixed)
        before = builder.block
        with builder.if_then(has_tie, likely=False):
            is_lower = builder.icmp_signed("<", face, load_other())
            both = builder.or_(is_nearer, builder.and_(is_tied, is_lower))
            inside = builder.block
        found = builder.phi(is_nearer.type)
        found.add_incoming(is_nearer, before)
        found.add_incoming(both, inside)
        return found

    def to_stored(self, depth: Any, limits: Any) -> Any:
        """Return depths in stored form, clamped to limits."""
        builder, (low, high) = self._builder, limits
        depth = builder.select(builder.fcmp_ordered("<", depth, low), low, depth)
        depth = builder.select(builder.fcmp_ordered(">", depth, high), high, depth)
        stored = ir.VectorType(self.stored, depth.type.count)
        if isinstance(self.stored, ir.IntType):
            return builder.fptosi(depth, stored)
        return depth if depth.type == stored else builder.fptrunc(depth, stored)

    def _load(self, place: Any, align: int) -> Any:
        """
        Load lanes that are stored again, some of them changed.

        LLVM makes a masked store of that, which takes an AMD without AVX-512 twenty to forty steps:
        15 to 38 % of all visibility. A fence within a thread is no instruction, but keeps load and
        store apart. With AVX-512 the masked store is the faster one, by 3 to 7 %.
        """
        value = self._builder.load(place, align=align)
        if not self._has_masks:
            self._builder.fence("acq_rel", "singlethread")
        return value


@intrinsic
def draw_box(
    typing_context: Any, depths: Any, numbers: Any, first: Any, stride: Any, rows: Any,
    columns: Any, edges: Any, plane: Any, face: Any, is_mixed: Any,
) -> Any:  # fmt: skip
    """Test a box of at most ``LANES`` columns of samples against three edges and the depth."""

    def draw(
        context: Any, builder: Any, signature: Any, arguments: Any, lanes: int, is_mixed: bool
    ) -> None:
        # The lanes of the first row, and what each row adds to them.
        first, stride, rows, columns, edges, plane, face = arguments[2:9]
        tile = _Tile(context, builder, signature, arguments)
        edge, real = _extract_elements(builder, edges, 9), _extract_elements(builder, plane, 11)
        is_whole = isinstance(edge[0].type, ir.IntType)
        sides = [_arithmetic_lanes(builder, edge[k], edge[k + 3], lanes) for k in range(3)]
        exact = [_arithmetic_lanes(builder, real[k], real[k + 2], lanes) for k in range(2)]
        down = [_broadcast(builder, value, lanes) for value in (*edge[6:], *real[4:6])]
        depth, weight_a, weight_b, *limits = (
            _broadcast(builder, value, lanes) for value in real[6:]
        )
        faces, column_counts = _broadcast(builder, face, lanes), _broadcast(builder, columns, lanes)
        is_column = builder.icmp_signed("<", _lane_numbers(LANE, lanes), column_counts)
        zero = ir.Constant(sides[0].type, [0 if is_whole else 0.0] * lanes)

        def draw_row(_: Any, values: list[Any]) -> list[Any]:
            place, s0, s1, s2, e0, e1 = values
            tile.check(builder.add(place, place.type(lanes)))
            if is_whole:
                least = builder.or_(s0, builder.or_(s1, s2))
                is_inside = builder.and_(is_column, builder.icmp_signed(">=", least, zero))
            else:
                is_inside = is_column
                for side in (s0, s1, s2):
                    is_inside = builder.and_(is_inside, builder.fcmp_ordered(">=", side, zero))
            here = builder.fadd(builder.fmul(e0, weight_a), builder.fmul(e1, weight_b))
            tile.store_nearer(place, is_inside, builder.fadd(depth, here), limits, faces, is_mixed)
            steps = (_add(builder, *pair) for pair in zip(values[1:], down, strict=True))
            return [builder.add(place, stride), *steps]

        _loop(builder, rows, [first, *sides, *exact], draw_row)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        is_narrow = builder.icmp_signed("<=", arguments[5], LANE(LANES // 2))
        with builder.if_else(is_narrow) as branches:
            for branch, lanes in zip(branches, (LANES // 2, LANES), strict=True):
                with branch, builder.if_else(arguments[9]) as orders:
                    for order, is_mixed in zip(orders, (True, False), strict=True):
                        with order:
                            draw(context, builder, signature, arguments, lanes, is_mixed)
        return context.get_dummy_value()

    kinds = types.UniTuple(edges.dtype, 9), types.UniTuple(plane.dtype, 11)
    whole = types.int64, types.int64, types.int64, types.int32
    argument_types = depths, numbers, *whole, *kinds, types.int32, types.boolean
    return types.void(*argument_types), generate


def _fill_single_columns(context: Any, builder: Any, signature: Any, arguments: Any) -> None:
    """
    Do what `fill_rows` does, where no row has more than one sample.

    Vectors are of rows. Which samples are nearer is hard to predict, so nothing branches.
    """
    spans, first, stride, rows, before, _, plane, face = arguments[2:10]
    tile, kinds = _Tile(context, builder, signature, arguments), signature.args[2]
    begins, ends, starts = (
        load_field(context, builder, kinds[k], builder.extract_value(spans, k), "data")
        for k in range(3)
    )
    slope, *limits = (_broadcast(builder, v, LANES) for v in _extract_elements(builder, plane, 3))
    before, count, faces = (
        _broadcast(builder, v, LANES) for v in (before, builder.trunc(rows, LANE), face)
    )
    steps = _broadcast(builder, builder.trunc(stride, LANE), LANES)
    numbers, lanes = _lane_numbers(LANE, LANES), ir.Constant(steps.type, [LANES] * LANES)

    def draw_group(number: Any, values: list[Any]) -> list[Any]:
        row = builder.mul(number, number.type(LANES))
        begin, end, start = (
            _load_lanes(builder, array, row, align)
            for array, align in ((begins, 4), (ends, 4), (starts, 8))
        )
        is_row = builder.icmp_signed("<", values[0], count)
        is_behind = builder.icmp_signed(">=", begin, before)
        is_inside = builder.and_(is_behind, builder.icmp_signed("<", begin, end))
        is_inside = builder.and_(is_inside, is_row)
        zero = ir.Constant(start.type, [0.0] * LANES)
        depth = tile.to_stored(builder.fadd(start, builder.fmul(zero, slope)), limits)
        column = builder.select(is_behind, begin, before)
        place = builder.add(builder.mul(values[0], steps), column)
        # What lies behind the last row stands in for the first row, which is stored after it.
        place = builder.select(
            is_row, place, _broadcast(builder, builder.extract_element(place, LANE(0)), LANES)
        )
        places = [
            builder.add(first, builder.sext(builder.extract_element(place, LANE(k)), first.type))
            for k in range(LANES)
        ]
        tile.scatter_nearer(places, is_inside, depth, faces, arguments[10])
        return [builder.add(values[0], lanes)]

    groups = builder.lshr(builder.add(rows, rows.type(LANES - 1)), rows.type(3))
    _loop(builder, groups, [numbers], draw_group)


@intrinsic
def fill_rows(
    typing_context: Any, depths: Any, numbers: Any, spans: Any, first: Any, stride: Any, rows: Any,
    before: Any, longest: Any, plane: Any, face: Any, is_mixed: Any,
) -> Any:  # fmt: skip
    """Test the samples of each row from its begin, or from ``before``, to its end."""

    def draw(
        context: Any, builder: Any, signature: Any, arguments: Any, lanes: int, is_mixed: bool
    ) -> None:
        spans, first, stride, rows, before, _, plane, face = arguments[2:10]
        tile, kinds = _Tile(context, builder, signature, arguments), signature.args[2]
        begins, ends, starts = (
            load_field(context, builder, kinds[k], builder.extract_value(spans, k), "data")
            for k in range(3)
        )
        slope, *limits = (
            _broadcast(builder, v, lanes) for v in _extract_elements(builder, plane, 3)
        )
        real = slope.type.element
        faces, numbers = _broadcast(builder, face, lanes), _lane_numbers(LANE, lanes)

        def draw_row(row: Any, values: list[Any]) -> list[Any]:
            begin, end = (
                builder.load(builder.gep(begins, [row])),
                builder.load(builder.gep(ends, [row])),
            )
            start = _broadcast(builder, builder.load(builder.gep(starts, [row])), lanes)
            column = builder.select(builder.icmp_signed(">", begin, before), begin, before)
            steps = _broadcast(builder, builder.sitofp(builder.sub(column, begin), real), lanes)
            count = builder.sub(end, column)
            counts = _broadcast(builder, count, lanes)
            place = builder.add(values[0], builder.sext(column, values[0].type))

            def draw_group(_: Any, values: list[Any]) -> list[Any]:
                place, here, along = values
                tile.check(builder.add(place, place.type(lanes)))
                depth = builder.fadd(start, builder.fmul(along, slope))
                is_inside = builder.icmp_signed("<", here, counts)
                tile.store_nearer(place, is_inside, depth, limits, faces, is_mixed)
                following = (
                    _add(builder, value, ir.Constant(value.type, [lanes] * lanes))
                    for value in (here, along)
                )
                return [builder.add(place, place.type(lanes)), *following]

            first_group = [place, numbers, builder.fadd(steps, _lane_numbers(real, lanes))]
            if lanes < LANES:
                # No row is longer
                draw_group(None, first_group)
            else:
                groups = builder.ashr(
                    builder.add(count, LANE(lanes - 1)), LANE(lanes.bit_length() - 1)
                )
                # One group at least: which rows are empty is hard to predict
                is_some = builder.icmp_signed(">", groups, LANE(1))
                groups = builder.select(is_some, groups, LANE(1))
                _loop(builder, groups, first_group, draw_group)
            return [builder.add(values[0], stride)]

        _loop(builder, rows, [first], draw_row)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        longest = arguments[7]
        # Of few rows, a vector of rows is mostly empty.
        is_thin = builder.and_(
            builder.icmp_signed("<=", longest, longest.type(1)),
            builder.icmp_signed(">", arguments[5], arguments[5].type(LANES)),
        )
        is_narrow = builder.icmp_signed("<=", longest, longest.type(LANES // 2))
        with builder.if_else(is_thin) as (thin, others):
            with thin:
                _fill_single_columns(context, builder, signature, arguments)
            with others, builder.if_else(is_narrow) as branches:
                for branch, lanes in zip(branches, (LANES // 2, LANES), strict=True):
                    with branch, builder.if_else(arguments[10]) as orders:
                        for order, is_mixed in zip(orders, (True, False), strict=True):
                            with order:
                                draw(context, builder, signature, arguments, lanes, is_mixed)
        return context.get_dummy_value()

    three = types.UniTuple(plane.dtype, 3)
    whole = types.int64, types.int64, types.int64, types.int32, types.int64
    argument_types = depths, numbers, spans, *whole, three, types.int32, types.boolean
    return types.void(*argument_types), generate


@intrinsic
def find_min_in_rows(
    typing_context: Any, values: Any, first: Any, stride: Any, rows: Any, left: Any, right: Any
) -> Any:
    """Return the least value in some columns, of ``LANES``, of some rows."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, first, stride, rows, left, right = arguments
        kind = context.get_value_type(values.dtype)
        is_whole, vector = isinstance(kind, ir.IntType), ir.VectorType(kind, LANES)
        greatest = ir.Constant(vector, [2**31 - 1 if is_whole else float("inf")] * LANES)
        compare = builder.icmp_signed if is_whole else builder.fcmp_ordered
        data = load_field(context, builder, values, array, "data")
        length = list_axis_values(context, builder, values, array, "shape")[0]
        align = kind.get_abi_size(context.target_data)

        def lesser(one: Any, other: Any) -> Any:
            return builder.select(compare("<", one, other), one, other)

        def take_row(_: Any, running: list[Any]) -> list[Any]:
            place, least = running
            _check_end(context, builder, builder.add(place, place.type(LANES)), length)
            pointer = builder.bitcast(builder.gep(data, [place]), vector.as_pointer())
            row = builder.load(pointer, align=align)
            return [builder.add(place, stride), lesser(row, least)]

        _, least = _loop(builder, rows, [first, greatest], take_row)
        columns = _lane_numbers(LANE, LANES)
        is_column = builder.and_(
            builder.icmp_signed(">=", columns, _broadcast(builder, left, LANES)),
            builder.icmp_signed("<=", columns, _broadcast(builder, right, LANES)),
        )
        least, lanes = builder.select(is_column, least, greatest), LANES
        while lanes > 1:
            lanes //= 2
            half = [
                ir.Constant(ir.VectorType(LANE, lanes), list(range(k, k + lanes)))
                for k in (0, lanes)
            ]
            least = lesser(*(builder.shuffle_vector(least, least, lane) for lane in half))
        return builder.extract_element(least, LANE(0))

    whole = types.int64, types.int64, types.int64, types.int32, types.int32
    return values.dtype(values, *whole), generate


@intrinsic
def find_range_end(typing_context: Any, numbers: Any, start: Any, first: Any, end: Any) -> Any:
    """Return the first place from ``start`` on whose int32 is not in first..end - 1, or the end."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, start, first, stop = arguments
        data = load_field(context, builder, numbers, array, "data")
        length = list_axis_values(context, builder, numbers, array, "shape")[0]
        lanes, count = 2 * LANES, builder.sub(stop, first)
        lowest, counts = _broadcast(builder, first, lanes), _broadcast(builder, count, lanes)
        before = builder.block
        names = ("vectors", "vector", "found", "singles", "single", "after")
        vectors, vector, found, singles, single, after = map(builder.append_basic_block, names)
        builder.branch(vectors)
        # Compare whole vectors; unsigned, so numbers below the first are large.
        builder.position_at_end(vectors)
        place = builder.phi(start.type)
        following = builder.add(place, place.type(lanes))
        builder.cbranch(builder.icmp_signed("<=", following, length), vector, singles)
        builder.position_at_end(vector)
        pointer = builder.bitcast(builder.gep(data, [place]), lowest.type.as_pointer())
        above = builder.sub(builder.load(pointer, align=4), lowest)
        mask = builder.bitcast(builder.icmp_unsigned(">=", above, counts), ir.IntType(lanes))
        place.add_incoming(start, before)
        place.add_incoming(following, vector)
        builder.cbranch(builder.icmp_signed("==", mask, mask.type(0)), vectors, found)
        builder.position_at_end(found)
        lane = builder.zext(builder.cttz(mask, ir.IntType(1)(1)), start.type)
        outside = builder.add(place, lane)
        builder.branch(after)
        # Compare the rest one by one.
        builder.position_at_end(singles)
        last = builder.phi(start.type)
        builder.cbranch(builder.icmp_signed("<", last, length), single, after)
        builder.position_at_end(single)
        above = builder.sub(builder.load(builder.gep(data, [last])), first)
        last.add_incoming(place, vectors)
        last.add_incoming(builder.add(last, last.type(1)), single)
        builder.cbranch(builder.icmp_unsigned("<", above, count), singles, after)
        builder.position_at_end(after)
        reached = builder.phi(start.type)
        for value, origin in ((outside, found), (last, singles), (last, single)):
            reached.add_incoming(value, origin)
        return reached

    return types.int64(numbers, types.int64, types.int32, types.int32), generate


def _make_blend(builder: Any, corners: Any, base: Any) -> Callable:
    """Return a function of weights: a base times the mix of vertices' colours, clamped to these."""
    corner = [
        [_broadcast(builder, value, LANES) for value in _extract_elements(builder, vertex, 3)]
        for vertex in _extract_elements(builder, corners, 3)
    ]
    shown = [_broadcast(builder, value, LANES) for value in _extract_elements(builder, base, 3)]

    def lesser(value: Any, other: Any) -> Any:
        return builder.select(builder.fcmp_ordered("<", value, other), value, other)

    def greater(value: Any, other: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", value, other), value, other)

    limits = [
        [
            pick_bound(corner[0][k], pick_bound(corner[1][k], corner[2][k]))
            for pick_bound in (greater, lesser)
        ]
        for k in range(3)
    ]

    def blend(weights: list[Any]) -> list[Any]:
        colors = []
        for k in range(3):
            parts = [builder.fmul(weights[j], corner[j][k]) for j in range(3)]
            value = builder.fadd(builder.fadd(parts[0], parts[1]), parts[2])
            most, least = limits[k]
            colors.append(builder.fmul(shown[k], lesser(greater(value, least), most)))
        return colors

    return blend


@intrinsic
def blend_run(
    typing_context: Any, red: Any, green: Any, blue: Any, edges: Any, steps: Any, ratios: Any,
    corners: Any, base: Any,
) -> Any:  # fmt: skip
    """Write the colours of neighbouring samples of one face: a base times those of its vertices."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        rows = [load_field(context, builder, red, row, "data") for row in arguments[:3]]
        length = list_axis_values(context, builder, red, arguments[0], "shape")[0]
        groups = builder.ashr(length, length.type(LANES.bit_length() - 1))
        edge, step = (_extract_elements(builder, tuple_, 3) for tuple_ in arguments[3:5])
        starts = [_arithmetic_lanes(builder, *pair, LANES) for pair in zip(edge, step, strict=True)]
        strides = [
            _broadcast(builder, builder.fmul(each, each.type(float(LANES))), LANES) for each in step
        ]
        ratio_b, ratio_c = (
            _broadcast(builder, v, LANES) for v in _extract_elements(builder, arguments[5], 2)
        )
        blended = _make_blend(builder, arguments[6], arguments[7])
        single = ratio_b.type
        one = ir.Constant(single, [1.0] * LANES)

        def blend(number: Any, exact: list[Any]) -> list[Any]:
            first, second, third = (builder.fptrunc(value, single) for value in exact)
            second, third = builder.fmul(second, ratio_b), builder.fmul(third, ratio_c)
            total = builder.fadd(builder.fadd(first, second), third)
            over = builder.fdiv(one, total)
            weights = [builder.fmul(value, over) for value in (first, second, third)]
            place = builder.mul(number, number.type(LANES))
            for row, value in zip(rows, blended(weights), strict=True):
                target = builder.bitcast(builder.gep(row, [place]), single.as_pointer())
                builder.store(value, target, align=4)
            return [_add(builder, *pair) for pair in zip(exact, strides, strict=True)]

        _loop(builder, groups, starts, blend)
        return context.get_dummy_value()

    exact, color = types.UniTuple(types.float64, 3), types.UniTuple(types.float32, 3)
    pair, three = types.UniTuple(types.float32, 2), types.UniTuple(color, 3)
    return types.void(red, red, red, exact, exact, pair, three, color), generate


@intrinsic
def blend_clipped_run(
    typing_context: Any, red: Any, green: Any, blue: Any, memory: Any, odd: Any, width: Any,
    xs: Any, ws: Any, down: Any, corners: Any, base: Any,
) -> Any:  # fmt: skip
    """
    Do what `blend_run` does for a face that was clipped; return not 0 if a sum is not positive.

    In two loops: in one, so many steps would follow each other that a CPU finds too few to do at a
    time.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kinds = signature.args
        rows = [load_field(context, builder, kinds[k], arguments[k], "data") for k in range(3)]
        places = [
            load_field(
                context, builder, kinds[3][k], builder.extract_value(arguments[3], k), "data"
            )
            for k in range(4)
        ]
        length = list_axis_values(context, builder, red, arguments[0], "shape")[0]
        groups = builder.ashr(length, length.type(LANES.bit_length() - 1))
        double = ir.VectorType(ir.DoubleType(), LANES)
        single = ir.VectorType(ir.FloatType(), LANES)
        one, none = (ir.Constant(double, [value] * LANES) for value in (1.0, 0.0))
        width = _broadcast(builder, arguments[5], LANES)
        xs, ws, down = (
            [_broadcast(builder, value, LANES) for value in _extract_elements(builder, row, 3)]
            for row in arguments[6:9]
        )

        def pointer(row: Any, number: Any, kind: Any) -> Any:
            place = builder.gep(row, [builder.mul(number, number.type(LANES))])
            return builder.bitcast(place, kind.as_pointer())

        def product(pair: tuple[Any, Any]) -> Any:
            return builder.fmul(*pair)

        def sum_three(values: list[Any]) -> Any:
            return builder.fadd(builder.fadd(values[0], values[1]), values[2])

        def weigh(number: Any, running: list[Any]) -> list[Any]:
            odds, least, sums = running
            x = builder.fsub(builder.fdiv(odds, width), one)
            across = [builder.fsub(xs[k], product((x, ws[k]))) for k in range(3)]
            areas = [
                builder.fsub(
                    product((across[k - 2], down[k - 1])), product((across[k - 1], down[k - 2]))
                )
                for k in range(3)
            ]  # fmt: skip
            clamped = [
                builder.select(builder.fcmp_ordered(">", none, area), none, area) for area in areas
            ]
            for value, row in zip([*clamped, sum_three(clamped)], places, strict=True):
                builder.store(value, pointer(row, number, double), align=8)
            total = sum_three(areas)
            least = builder.select(builder.fcmp_ordered("<", total, least), total, least)
            step = ir.Constant(double, [2.0 * LANES] * LANES)
            # Their sum is NaN if one of them is.
            return [builder.fadd(odds, step), least, builder.fadd(sums, total)]

        first = _arithmetic_lanes(builder, arguments[4], arguments[4].type(2.0), LANES)
        _, least, sums = _loop(builder, groups, [first, one, none], weigh)
        blend = _make_blend(builder, arguments[9], arguments[10])

        def divide(number: Any, _: list[Any]) -> list[Any]:
            *areas, total = (builder.load(pointer(row, number, double), align=8) for row in places)
            weights = [builder.fptrunc(builder.fdiv(area, total), single) for area in areas]
            for row, value in zip(rows, blend(weights), strict=True):
                builder.store(value, pointer(row, number, single), align=4)
            return []

        _loop(builder, groups, [], divide)
        is_positive = builder.and_(
            builder.fcmp_ordered(">", least, none), builder.fcmp_ordered("ord", sums, none)
        )
        positive_bits = builder.bitcast(is_positive, ir.IntType(LANES))
        return builder.zext(
            builder.icmp_signed("!=", positive_bits, positive_bits.type((1 << LANES) - 1)), LANE
        )

    exact, color = types.UniTuple(types.float64, 3), types.UniTuple(types.float32, 3)
    argument_types = (
        types.float64,
        types.float64,
        exact,
        exact,
        exact,
        types.UniTuple(color, 3),
        color,
    )
    return types.int32(red, red, red, memory, *argument_types), generate


@intrinsic
def encode_lanes(
    typing_context: Any, red: Any, green: Any, blue: Any, table: Any, first: Any, others: Any,
    color: Any,
) -> Any:  # fmt: skip
    """
    Write the codes of ``LANES`` neighbouring pixels.

    Reads the upper halves of values as 16-bit numbers of their own: to take them out of a vector,
    as LLVM does where it finds no quick instruction that reads a table, takes half as long again.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kinds, (*light, entries, start, other_bits, target) = signature.args, arguments
        whole, half = ir.VectorType(LANE, LANES), ir.IntType(16)
        entries = load_field(context, builder, kinds[3], entries, "data")
        size = list_axis_values(context, builder, kinds[6], target, "shape")[0]
        _check_end(context, builder, builder.add(start, start.type(LANES)), size)

        def constant(number: int) -> Any:
            return ir.Constant(whole, [number] * LANES)

        pixels = _broadcast(builder, other_bits, LANES)
        for k, row in enumerate(light):
            place = builder.gep(load_field(context, builder, kinds[k], row, "data"), [start])
            halves = builder.bitcast(place, half.as_pointer())
            found = ir.Constant(whole, ir.Undefined)
            for lane in range(LANES):
                upper = builder.load(builder.gep(halves, [LANE(2 * lane + 1)]), align=2)
                entry = builder.load(builder.gep(entries, [builder.zext(upper, WORD)]), align=4)
                found = builder.insert_element(found, entry, LANE(lane))
            bits = builder.load(builder.bitcast(place, whole.as_pointer()), align=4)
            code = builder.add(found, builder.and_(bits, constant(0xFFFF)))
            code = builder.and_(builder.lshr(code, constant(16)), constant(0xFF))
            pixels = builder.or_(pixels, builder.shl(code, constant(8 * k)))
        place = builder.gep(load_field(context, builder, kinds[6], target, "data"), [start])
        builder.store(pixels, builder.bitcast(place, whole.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(red, green, blue, table, types.int64, types.uint32, color), generate


def _pointer(builder: Any, address: Any, bits: int) -> Any:
    return builder.inttoptr(address, ir.IntType(bits).as_pointer())


@intrinsic
def load_int64(typing_context: Any, address: Any) -> Any:
    """Return the word at an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(_pointer(builder, arguments[0], 64))

    return types.int64(types.int64), generate


@intrinsic
def load_int32(typing_context: Any, address: Any) -> Any:
    """Return the 32-bit word at an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(_pointer(builder, arguments[0], 32))

    return types.int32(types.int64), generate


@intrinsic
def store_int64(typing_context: Any, address: Any, value: Any) -> Any:
    """Write the word at an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.store(arguments[1], _pointer(builder, arguments[0], 64))
        return context.get_dummy_value()

    return types.void(types.int64, types.int64), generate


@intrinsic
def add_to_element_atomically(typing_context: Any, row: Any, place: Any, value: Any) -> Any:
    """Add to an element of a row of int64 that threads share, in one step; return what it was."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, index, added = arguments
        element = builder.gep(load_field(context, builder, row, array, "data"), [index])
        return builder.atomic_rmw("add", element, added, "acq_rel")

    return types.int64(row, types.intp, types.int64), generate


@intrinsic
def load_atomic(typing_context: Any, address: Any) -> Any:
    """Load the word at an address that other threads write, with acquire semantics."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load_atomic(_pointer(builder, arguments[0], 64), "acquire", 8)

    return types.int64(types.int64), generate


@intrinsic
def add_atomic(typing_context: Any, address: Any, value: Any) -> Any:
    """Add to the word at an address in one step; return what it was."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = _pointer(builder, arguments[0], 64)
        return builder.atomic_rmw("add", place, arguments[1], "acq_rel")

    return types.int64(types.int64, types.int64), generate


@intrinsic
def compare_exchange(typing_context: Any, address: Any, expected: Any, value: Any) -> Any:
    """Write the word at an address if it is as expected, in one step; return what it was."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = _pointer(builder, arguments[0], 64)
        pair = builder.cmpxchg(place, *arguments[1:], "acq_rel", "acquire")
        return builder.extract_value(pair, 0)

    return types.int64(types.int64, types.int64, types.int64), generate


@intrinsic
def pause_cpu(typing_context: Any) -> Any:
    """Hint to the processor that a loop waits for another thread."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        # "pause" and "yield".
        known = {"x86": ("llvm.x86.sse2.pause", []), "ARM": ("llvm.aarch64.hint", [LANE(1)])}
        processor = current_target().triple.split("-")[0]
        family = {"x86_64": "x86", "aarch64": "ARM", "arm64": "ARM"}.get(processor)
        if family is not None:
            name, operands = known[family]
            kind = ir.FunctionType(ir.VoidType(), [operand.type for operand in operands])
            builder.call(builder.module.declare_intrinsic(name, (), kind), operands)
        return context.get_dummy_value()

    return types.void(), generate


@intrinsic
def call_at(typing_context: Any, address: Any, state: Any, first: Any, stop: Any) -> Any:
    """Call ``int64 f(int64, int64, int64)`` at an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word = ir.IntType(64)
        function = ir.FunctionType(word, [word] * 3).as_pointer()
        return builder.call(builder.inttoptr(arguments[0], function), arguments[1:])

    return types.int64(types.int64, types.int64, types.int64, types.int64), generate


PAIR = ir.VectorType(LANE, 2)
"""x and y of a vertex: int32, side by side."""


def _load_pair(context: Any, builder: Any, kind: Any, pairs: Any, number: Any) -> Any:
    """Load a pair of an array of pairs."""
    length, _ = list_axis_values(context, builder, kind, pairs, "shape")
    stride, inner = list_axis_values(context, builder, kind, pairs, "strides")
    _check_end(context, builder, builder.add(number, number.type(1)), length)
    _check_end(context, builder, inner, inner.type(LANE.width // 8))
    data = load_field(context, builder, kind, pairs, "data")
    data = builder.bitcast(data, ir.IntType(8).as_pointer())
    place = builder.gep(data, [builder.mul(number, stride)])
    return builder.load(builder.bitcast(place, PAIR.as_pointer()), align=4)


def _store_pair(context: Any, builder: Any, kind: Any, row: Any, n: Any, pair: Any) -> None:
    """Store a pair to places 2 n and 2 n + 1 of a row."""
    place = builder.shl(n, n.type(1))
    length = list_axis_values(context, builder, kind, row, "shape")[0]
    _check_end(context, builder, builder.add(place, place.type(2)), length)
    target = builder.gep(load_field(context, builder, kind, row, "data"), [place])
    builder.store(pair, builder.bitcast(target, PAIR.as_pointer()), align=4)


@intrinsic
def store_bounds(
    typing_context: Any, xy: Any, a: Any, b: Any, c: Any, least: Any, most: Any, n: Any
) -> Any:
    """Write the least x and y of three vertices, and the greatest, to two places of rows."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        vertices = [_load_pair(context, builder, xy, arguments[0], n) for n in arguments[1:4]]
        for row, value, operator in zip((least, most), arguments[4:6], "<>", strict=True):
            found = vertices[0]
            for other in vertices[1:]:
                found = builder.select(builder.icmp_signed(operator, found, other), found, other)
            _store_pair(context, builder, row, value, arguments[6], found)
        return context.get_dummy_value()

    vertices = types.uintp, types.uintp, types.uintp
    return types.void(xy, *vertices, least, most, types.uintp), generate


@intrinsic
def copy_pair(typing_context: Any, pairs: Any, number: Any, row: Any, n: Any) -> Any:
    """Copy one of some pairs of int32 to places 2 n and 2 n + 1 of a row."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        value = _load_pair(context, builder, pairs, *arguments[:2])
        _store_pair(context, builder, row, *arguments[2:], value)
        return context.get_dummy_value()

    return types.void(pairs, types.uintp, row, types.uintp), generate


@intrinsic
def prefetch(typing_context: Any, row: Any, number: Any) -> Any:
    """Prefetch the cache line of an element of a row."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, index = arguments
        place = load_field(context, builder, row, array, "data")
        if row.layout == "C":
            place = builder.gep(place, [index])
        else:
            stride = list_axis_values(context, builder, row, array, "strides")[0]
            place = builder.bitcast(place, ir.IntType(8).as_pointer())
            place = builder.gep(place, [builder.mul(index, stride)])
        _prefetch(builder, place)
        return context.get_dummy_value()

    return types.void(row, types.uintp), generate


@intrinsic
def flat(typing_context: Any, array: Any) -> Any:
    """Return a contiguous array as one row, without a copy."""
    if array.layout != "C":
        raise TypeError(f"a row is made of a contiguous array, not of {array}")
    row = array.copy(ndim=1)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        count = WORD(1)
        for length in list_axis_values(context, builder, array, arguments[0], "shape"):
            count = builder.mul(count, length)
        return _make_row(context, builder, row, array, arguments[0], None, count)

    return row(array), generate
