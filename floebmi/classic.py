"""How long a file of NetCDF's classic formats (CDF-1, 2, 5) must be, by its header.

netCDF4 reads what lies beyond the end of such a file as zeros; scipy, which would not, refuses whole files whose only
record variable has records of an odd length.  The formats: NetCDF User's Guide, Appendix B, "File Format Specifications".
"""

import math
import os
import struct
from typing import BinaryIO

# bytes of a value of each type, from 1: byte, char, short, int, float, double; CDF-5 goes on to uint64
SIZES = dict(enumerate((1, 1, 2, 4, 4, 8, 1, 2, 4, 8, 8), start=1))


def length_by_header(file: BinaryIO) -> int:
    """Bytes that a file of formats CDF-1, 2 or 5 must have by its header, but for padding at its end; 0 for another."""
    magic = file.read(4)
    if magic[:3] != b"CDF" or magic[3:] not in (b"\1", b"\2", b"\5"):
        return 0
    count, place = {1: (">I", ">I"), 2: (">I", ">Q"), 5: (">Q", ">Q")}[magic[3]]

    def number(kind: str) -> int:
        return int(struct.unpack(kind, file.read(struct.calcsize(kind)))[0])

    def skip(size: int) -> None:
        file.seek(size + -size % 4, os.SEEK_CUR)

    def entries() -> range:
        number(">I")  # the tag of a list
        return range(number(count))

    def skip_attributes() -> None:
        for _ in entries():
            skip(number(count))
            size = SIZES.get(number(">I"), 0)
            skip(size * number(count))

    records = number(count)
    if records == 256 ** struct.calcsize(count) - 1:
        records = 0  # of a stream, which does not know how many come
    lengths = []
    for _ in entries():
        skip(number(count))
        lengths.append(number(count))
    skip_attributes()
    ends, of_records = [0], []
    for _ in entries():
        skip(number(count))
        shape = [lengths[number(count)] for _ in range(number(count))]
        skip_attributes()
        value = SIZES.get(number(">I"), 0)
        number(count)  # vsize, which cannot tell sizes over 4 GiB
        begin = number(place)
        if shape and shape[0] == 0:  # the dimension of records has length 0 in the header
            of_records.append((begin, value * math.prod(shape[1:])))
        else:
            ends.append(begin + value * math.prod(shape))
    alone = len(of_records) == 1  # then records are not padded
    step = sum(size + (0 if alone else -size % 4) for _, size in of_records)
    if records:
        ends += [begin + (records - 1) * step + size for begin, size in of_records]
    return max(ends)
