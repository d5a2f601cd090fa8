"""Transposition of four pairs at a time from floes to columns and back, for fast contact arithmetic.

A floe is a row of eight numbers; arithmetic on many pairs at once needs columns, one quantity of many pairs.
Read one by one, the numbers of a pair cost more than its contact law.  Here half a row is read at once, and four
half rows are transposed into columns.  Compilers do not find this by themselves, so it is written in LLVM
vectors, which every processor has or emulates.  The Python bodies of `gather` and `scatter` define what they do, and
run where nothing is compiled (NUMBA_DISABLE_JIT=1, to step through a law in a debugger).
"""

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload

from floebmi.kernels import BLOCK, IN_PLACE

LANES = 4  # pairs at a time
# Rows of the buffer of a block of pairs.  Results are in lower rows than their inputs: the compiler then sees that a
# store can only overwrite what has already been read, and vectorises the loop.
FX, FY, TORQUE_I, TORQUE_J, BLOW_N, BLOW_T = (row * BLOCK for row in range(6))
DX, DY, DU, DV, R_I, R_J, H_I, H_J, OMEGA_I, OMEGA_J, W_I, W_J = (
    row * BLOCK for row in range(6, 18)
)
MU, SIGMA = (row * BLOCK for row in range(18, 20))
PAIR_BUFFER = 20 * BLOCK

_BYTE, _INDEX, _LANE = ir.IntType(8), ir.IntType(64), ir.IntType(32)
_NUMBER = ir.DoubleType()
_HALF, _FULL = ir.VectorType(_NUMBER, 2), ir.VectorType(_NUMBER, LANES)


def _mix(builder, one, other, *lanes):
    """A vector of some lanes of two others, whose lanes are numbered consecutively."""
    wanted = ir.Constant(ir.VectorType(_LANE, len(lanes)), list(lanes))
    return builder.shuffle_vector(one, other, wanted)


class _Place:
    """Memory of an array, read and written in vectors at an offset in bytes."""

    def __init__(self, context, builder, kind, value):
        data = context.make_array(kind)(context, builder, value).data
        self.builder, self.data = builder, builder.bitcast(data, _BYTE.as_pointer())
        self.row = context.get_abi_sizeof(context.get_data_type(kind.dtype))

    def at(self, distance, vector):
        place = self.builder.gep(self.data, [distance])
        return self.builder.bitcast(place, vector.as_pointer())

    def read(self, distance, vector=_FULL):
        return self.builder.load(self.at(distance, vector), align=8)

    def write(self, distance, value):
        self.builder.store(value, self.at(distance, value.type), align=8)


def _distances(builder, indices, first, row):
    """Offsets of the rows of four floes, in bytes from the first row."""
    found = []
    for lane in range(LANES):
        here = builder.mul(builder.add(first, _INDEX(lane)), _INDEX(indices.row))
        index = builder.load(indices.at(here, ir.IntType(8 * indices.row)), align=indices.row)
        found.append(builder.mul(builder.zext(index, _INDEX), _INDEX(row)))
    return found


def _columns(builder, place, distances, offset):
    """Four numbers of each of four rows, transposed into columns."""
    columns = []
    for half in (0, 16):
        a, b, c, d = (
            place.read(builder.add(distance, _INDEX(offset + half)), _HALF)
            for distance in distances
        )
        even, odd = _mix(builder, a, c, 0, 1, 2, 3), _mix(builder, b, d, 0, 1, 2, 3)
        columns += [_mix(builder, even, odd, 0, 4, 2, 6), _mix(builder, even, odd, 1, 5, 3, 7)]
    return columns


def gather(floes, pair_i, pair_j, first, buffer, k):
    """Fill columns for the pairs first + k to first + k + 3 of `floes`, records of `pack.FLOE`.

    DX, DY, DU, DV are differences, j minus i; R, H, OMEGA and W are the values of each floe.
    """
    for lane in range(k, k + LANES):
        one, other = floes[pair_i[first + lane]].tolist(), floes[pair_j[first + lane]].tolist()
        for row, own, others in zip((DX, DY, DU, DV), one, other, strict=False):
            buffer[row + lane] = others - own
        for rows, floe in (((R_I, H_I, OMEGA_I, W_I), one), ((R_J, H_J, OMEGA_J, W_J), other)):
            for row, value in zip(rows, floe[4:], strict=True):
                buffer[row + lane] = value


@overload(gather, jit_options=IN_PLACE)
def _gather(floes, pair_i, pair_j, first, buffer, k):
    return lambda floes, pair_i, pair_j, first, buffer, k: _gather_vectors(
        floes, pair_i, pair_j, first, buffer, k
    )


@intrinsic
def _gather_vectors(typing, floes, pair_i, pair_j, first, buffer, k):
    def generate(context, builder, signature, arguments):
        records, i, j, buffered = (
            _Place(context, builder, signature.args[n], arguments[n]) for n in (0, 1, 2, 4)
        )
        pair = builder.add(arguments[3], arguments[5])
        ours = _distances(builder, i, pair, records.row)
        theirs = _distances(builder, j, pair, records.row)
        column = builder.mul(arguments[5], _INDEX(8))

        def keep(row, value):
            buffered.write(builder.add(column, _INDEX(8 * row)), value)

        moving = zip(
            _columns(builder, records, ours, 0), _columns(builder, records, theirs, 0), strict=True
        )
        for row, (own, other) in zip((DX, DY, DU, DV), moving, strict=True):
            keep(row, builder.fsub(other, own))
        for rows, distances in (
            ((R_I, H_I, OMEGA_I, W_I), ours),
            ((R_J, H_J, OMEGA_J, W_J), theirs),
        ):
            for row, value in zip(rows, _columns(builder, records, distances, 32), strict=True):
                keep(row, value)
        return context.get_dummy_value()

    return types.void(floes, pair_i, pair_j, types.intp, buffer, types.intp), generate


def scatter(force, pair_i, pair_j, first, buffer, k):
    """Add columns of forces to floes: FX, FY to i and their opposite to j; TORQUE_I, TORQUE_J where floes rotate.

    force : records of `pack.FORCE` or `pack.FORCE_AND_TORQUE`
    """
    for lane in range(k, k + LANES):
        one, other = force[pair_i[first + lane]], force[pair_j[first + lane]]
        for row, name in ((FX, "x"), (FY, "y")):
            one[name] += buffer[row + lane]
            other[name] -= buffer[row + lane]
        if "torque" in force.dtype.names:
            one["torque"] += buffer[TORQUE_I + lane]
            other["torque"] += buffer[TORQUE_J + lane]


@overload(scatter, jit_options=IN_PLACE)
def _scatter(force, pair_i, pair_j, first, buffer, k):
    return lambda force, pair_i, pair_j, first, buffer, k: _scatter_vectors(
        force, pair_i, pair_j, first, buffer, k
    )


@intrinsic
def _scatter_vectors(typing, force, pair_i, pair_j, first, buffer, k):
    def generate(context, builder, signature, arguments):
        forces, i, j, buffered = (
            _Place(context, builder, signature.args[n], arguments[n]) for n in (0, 1, 2, 4)
        )
        pair = builder.add(arguments[3], arguments[5])
        ours = _distances(builder, i, pair, forces.row)
        theirs = _distances(builder, j, pair, forces.row)
        column = builder.mul(arguments[5], _INDEX(8))
        fx, fy, torque_i, torque_j = (
            buffered.read(builder.add(column, _INDEX(8 * row)))
            for row in (FX, FY, TORQUE_I, TORQUE_J)
        )
        turning = forces.row == 32

        def rows(torque):
            """The forces on four floes, one vector each."""
            none = ir.Constant(_FULL, [0.0] * LANES)
            even, odd = _mix(builder, fx, fy, 0, 4, 2, 6), _mix(builder, fx, fy, 1, 5, 3, 7)
            halves = [(even, 0), (odd, 0), (even, 2), (odd, 2)]
            if not turning:
                return [_mix(builder, v, v, lane, lane + 1) for v, lane in halves]
            even, odd = (
                _mix(builder, torque, none, 0, 4, 2, 6),
                _mix(builder, torque, none, 1, 5, 3, 7),
            )
            others = [(even, 0), (odd, 0), (even, 2), (odd, 2)]
            return [
                _mix(builder, v, w, lane, lane + 1, lane + 4, lane + 5)
                for (v, lane), (w, _) in zip(halves, others, strict=True)
            ]

        kind = _FULL if turning else _HALF
        given = rows(torque_i), rows(builder.fneg(torque_j))
        for lane in range(LANES):  # one at a time: two pairs may share a floe
            own, other = given[0][lane], given[1][lane]
            forces.write(ours[lane], builder.fadd(forces.read(ours[lane], kind), own))
            forces.write(theirs[lane], builder.fsub(forces.read(theirs[lane], kind), other))
        return context.get_dummy_value()

    return types.void(force, pair_i, pair_j, types.intp, buffer, types.intp), generate
