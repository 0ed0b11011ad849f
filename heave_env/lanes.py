"""Rows of a block as the compiler should see them: side by side, a constant distance apart.

Ordinary indexing hides from the compiler that the rows of a block never overlap: the distance between
rows is known at run time only, and each index may be negative. `block_of_lanes` states the distance
as a constant, `row` takes a row by its non-negative number. Both only address memory; they compute nothing.
"""

from __future__ import annotations

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array


@intrinsic(prefer_literal=True)
def block_of_lanes(typing_context, block, n_lanes):
    """The contiguous array (n_rows, n_lanes) itself, its number of lanes a constant of the compilation."""
    if not isinstance(n_lanes, types.IntegerLiteral):
        return None
    view = types.Array(block.dtype, 2, "C")

    def generate(context, builder, signature, arguments):
        given = make_array(signature.args[0])(context, builder, arguments[0])
        made = make_array(signature.return_type)(context, builder)
        itemsize = context.get_abi_sizeof(context.get_data_type(block.dtype))

        def whole(number):
            return context.get_constant(types.intp, number)

        populate_array(
            made,
            data=given.data,
            shape=cgutils.unpack_tuple(builder, given.shape, 2),
            strides=[whole(n_lanes.literal_value * itemsize), whole(itemsize)],
            itemsize=whole(itemsize),
            meminfo=None,
        )
        return made._getvalue()

    return view(block, n_lanes), generate


@intrinsic
def row(typing_context, block, number):
    """Row `number`, not negative, of a block, (n_lanes,)."""
    view = types.Array(block.dtype, 1, "C")

    def generate(context, builder, signature, arguments):
        given = make_array(signature.args[0])(context, builder, arguments[0])
        made = make_array(signature.return_type)(context, builder)
        itemsize = context.get_constant(
            types.intp, context.get_abi_sizeof(context.get_data_type(block.dtype))
        )
        distance = builder.sdiv(cgutils.unpack_tuple(builder, given.strides, 2)[0], itemsize)
        start = builder.mul(arguments[1], distance, flags=("nsw",))
        populate_array(
            made,
            data=builder.gep(given.data, [start], inbounds=True),
            shape=[cgutils.unpack_tuple(builder, given.shape, 2)[1]],
            strides=[itemsize],
            itemsize=itemsize,
            meminfo=None,
        )
        return made._getvalue()

    return view(block, types.intp), generate
