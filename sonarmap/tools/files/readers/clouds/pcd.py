"""Strict reader of PCD files of the Point Cloud Library: ascii, binary and binary_compressed.

Format: https://pointclouds.org/documentation/tutorials/pcd_file_format.html
"""

import re
import struct
from dataclasses import dataclass, replace
from itertools import accumulate
from math import prod

import lzf
import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.memory import require_memory
from sonarmap.tools.files.readers.clouds import rows
from sonarmap.tools.files.readers.clouds.cloud import Cloud, cloud_of_columns, column_roles

_HEADER = re.compile(rb"\A(.*?)^DATA[ \t]+(ascii|binary|binary_compressed)[ \t]*\r?\n", re.DOTALL | re.MULTILINE)
_HEADER_LIMIT = 1 << 20
_VIEWPOINT_NOTE = (
    "the line VIEWPOINT is taken as the sensor's place in the frame of the points; where the points are in the "
    "sensor's own frame, set it to 0 0 0 1 0 0 0"
)
_AT_ORIGIN: str = "0 0 0 1 0 0 0"
_SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}
_LZF_RATIO = 88  # highest compression of LZF: a repetition of 264 bytes takes three


_Columns = tuple[dict[str, np.ndarray], list[str]]  # columns by role, and notes


@dataclass(frozen=True, slots=True)
class _Header:
    """The header of a PCD file."""

    names: list[str]  # names, dtypes, counts: of each field
    dtypes: list[str]
    counts: list[int]  # values per point
    points: int  # number of points
    lines: int  # number of lines of the header
    viewpoint: np.ndarray  # (3,) float64, position of the sensor [m]

    @property
    def sizes(self) -> list[int]:
        return [int(dtype[-1]) * count for dtype, count in zip(self.dtypes, self.counts, strict=True)]


def read_pcd(content: bytes) -> list[Cloud]:
    """The points of a PCD file."""
    match = _HEADER.match(content[:_HEADER_LIMIT])
    if match is None:
        raise InputError("its PCD header has no line 'DATA ascii', 'DATA binary' or 'DATA binary_compressed'")
    header = _parse_header(match[1])
    roles = column_roles(header.names)
    wide = [header.names[column] for column in roles.values() if header.counts[column] != 1]
    if wide:
        raise InputError(f"field {', '.join(wide)} has more than one value per point (COUNT); wanted one")
    read = {b"ascii": _read_ascii, b"binary": _read_binary, b"binary_compressed": _read_compressed}[match[2]]
    columns, surplus = read(content, match.end(), header, roles)
    cloud = cloud_of_columns(columns, surplus)
    if cloud.viewpoints is None and header.viewpoint.any():
        viewpoints = np.tile(header.viewpoint, (len(cloud.points), 1))
        cloud = replace(cloud, viewpoints=viewpoints, notes=(*cloud.notes, _VIEWPOINT_NOTE))
    return [cloud]


def _parse_header(text: bytes) -> _Header:
    entries: dict[str, list[str]] = {}
    for line in text.decode("latin-1").split("\n"):
        words = line.replace(",", " ").split()
        if words and not words[0].startswith("#"):
            entries[words[0].upper()] = words[1:]
    missing = [name for name in ("FIELDS", "SIZE", "TYPE", "WIDTH", "HEIGHT") if not entries.get(name)]
    if missing:
        raise InputError(f"its PCD header has no {', '.join(missing)}; write the file again")
    names = entries["FIELDS"]
    ones = ["1"] * len(names)
    sizes, kinds, counts = entries["SIZE"], entries["TYPE"], entries.get("COUNT", ones)
    if not len(names) == len(sizes) == len(kinds) == len(counts):
        raise InputError("FIELDS, SIZE, TYPE and COUNT of its PCD header differ in length; write the file again")
    width, height = _count(entries, "WIDTH"), _count(entries, "HEIGHT")
    points = _count(entries, "POINTS") if "POINTS" in entries else width * height
    if points != width * height:
        raise InputError(f"its PCD header says POINTS {points} and WIDTH x HEIGHT {width} x {height}; write it again")
    return _Header(
        names=names,
        dtypes=[_dtype(kind, size) for kind, size in zip(kinds, sizes, strict=True)],
        counts=[_integer(count, "COUNT", least=1) for count in counts],
        points=points,
        lines=text.count(b"\n") + 1,
        viewpoint=_viewpoint(entries.get("VIEWPOINT") or _AT_ORIGIN.split()),
    )


def _count(entries: dict[str, list[str]], name: str) -> int:
    if len(entries[name]) != 1:
        raise InputError(f"{name} of its PCD header has {len(entries[name])} values; wanted one")
    return _integer(entries[name][0], name, least=0)


def _integer(text: str, name: str, least: int) -> int:
    if re.fullmatch(r"\d{1,18}", text, re.ASCII) is None or int(text) < least:
        raise InputError(f"its PCD header says {name} {rows.shown(text.encode())}; wanted an integer >= {least}")
    return int(text)


def _dtype(kind: str, size: str) -> str:
    if size not in {str(allowed) for allowed in _SIZES.get(kind, ())}:
        raise InputError(f"its TYPE {rows.shown(kind.encode())} of SIZE {rows.shown(size.encode())} is not known")
    return f"<{kind.lower()}{size}"


def _viewpoint(words: list[str]) -> np.ndarray:
    """PCL's sensor_origin (3,) float64 [m] in the line VIEWPOINT; the orientation is not needed."""
    numbers = np.array([float(word) if rows.is_number(word.encode()) else np.nan for word in words])
    if len(numbers) != 7 or not np.isfinite(numbers).all():
        given = rows.shown(" ".join(words).encode())
        raise InputError(f"its PCD header says VIEWPOINT {given}; wanted a place and a quaternion, as in {_AT_ORIGIN}")
    return numbers[:3]


def _read_ascii(content: bytes, start: int, header: _Header, roles: dict[str, int]) -> _Columns:
    lines = rows.whole_lines(content[start:], header.lines + 1)
    rows.require(f"{header.points:,} points and {len(lines):,} lines follow", header.points, len(lines))
    separator, points = rows.separated(lines[: header.points])
    numbers = rows.parse_rows(points, sum(header.counts), separator)
    starts = _starts(header.counts)
    columns = {role: numbers[:, starts[field]] for role, field in roles.items()}
    return columns, rows.surplus_note(len(lines) - header.points, "lines", "point")


def _read_binary(content: bytes, start: int, header: _Header, roles: dict[str, int]) -> _Columns:
    fields = list(zip(header.dtypes, header.sizes, strict=True))
    columns = rows.unpack_records(content, start, header.points, fields, roles)
    return columns, rows.surplus_note(len(content) - start - header.points * sum(header.sizes), "bytes", "point")


def _read_compressed(content: bytes, start: int, header: _Header, roles: dict[str, int]) -> _Columns:
    """The block holds two sizes, then LZF data with the values of all points for one field after another."""
    rows.require_bytes("two sizes", 8, len(content) - start)
    packed, unpacked = struct.unpack_from("<II", content, start)
    rows.require_bytes("compressed points", packed, len(content) - start - 8)
    needed = prod((header.points, sum(header.sizes)))
    if unpacked != needed or unpacked > packed * _LZF_RATIO:
        raise InputError(
            f"the header promises {header.points:,} points, {needed:,} bytes, and the compressed block is "
            f"{packed:,} bytes that claim to hold {unpacked:,}: the file is damaged; write or copy it again"
        )
    require_memory(f"a block that claims to hold {unpacked:,} bytes", unpacked, "thin its points out first")
    try:
        plain = lzf.decompress(content[start + 8 : start + 8 + packed], unpacked)
    except ValueError as error:
        raise InputError("its compressed points cannot be unpacked; write or copy the file again") from error
    if plain is None or len(plain) != unpacked:
        raise InputError("its compressed points unpack to another size; write or copy the file again")
    starts = _starts([size * header.points for size in header.sizes])
    columns = {
        role: np.frombuffer(plain, header.dtypes[field], header.points, starts[field]) for role, field in roles.items()
    }
    return columns, rows.surplus_note(len(content) - start - 8 - packed, "bytes", "point")


def _starts(lengths: list[int]) -> list[int]:
    return [0, *accumulate(lengths[:-1])]
