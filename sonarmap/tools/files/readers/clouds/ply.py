"""PLY: ascii and binary of both byte orders, read strictly.

Every element is walked, also those after the vertices, so that a file cut anywhere is noticed.
Format: G. Turk, The PLY Polygon File Format, 1994.
"""

import re
import struct
from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds.cloud import Cloud, cloud_of_columns, column_roles
from sonarmap.tools.files.readers.clouds.rows import (
    parse_rows,
    require_bytes,
    shown,
    surplus_note,
    unpack_records,
    whole_lines,
)

_HEADER = re.compile(rb"ply[ \t]*\r?\n(.*?)^end_header[ \t]*\r?\n", re.DOTALL | re.MULTILINE)
_HEADER_LIMIT = 1 << 20
_BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Property:
    name: str
    dtype: np.dtype
    length: np.dtype | None = None  # of a list's counter; None for a scalar


@dataclass(frozen=True, slots=True)
class _Element:
    name: str
    count: int
    properties: list[_Property]

    @property
    def least_bytes(self) -> int:
        """Bytes of one record whose lists are empty."""
        return sum((p.length or p.dtype).itemsize for p in self.properties)

    @property
    def has_list(self) -> bool:
        return any(p.length is not None for p in self.properties)


def read_ply(content: bytes) -> list[Cloud]:
    """The vertices of a PLY file. Raises InputError: anything that is not a whole, well-formed PLY file with vertices
    x, y, z."""
    header = _header_of(content)
    roles = column_roles([p.name for p in header.vertex.properties])
    if header.order == "":
        return [_read_ascii(content[header.end :], header.lines + 1, header.elements, header.vertex, roles)]
    columns, start = _read_binary(content, header, roles)
    return [cloud_of_columns(columns, surplus_note(len(content) - start, "bytes", "element"))]


def read_ply_columns(content: bytes) -> dict[str, np.ndarray]:
    """Every property (N,) of the vertices of a binary PLY file, by its name and as it is. Raises InputError: anything
    that is not a whole, well-formed binary PLY file with vertices."""
    header = _header_of(content)
    if header.order == "":
        raise InputError("it is an ascii PLY file; wanted a binary one, as `sonarmap map` writes")
    return _read_binary(content, header, {p.name: k for k, p in enumerate(header.vertex.properties)})[0]


@dataclass(frozen=True, slots=True)
class _Header:
    """Byte order (empty: ascii), elements, which of them are the vertices, and where the header ends."""

    order: str
    elements: list[_Element]
    vertex: _Element
    end: int
    lines: int


def _header_of(content: bytes) -> _Header:
    header = _HEADER.match(content[:_HEADER_LIMIT])
    if header is None:
        raise InputError("its PLY header has no line end_header: the file is cut or damaged; write it again")
    lines = header[1].decode("latin-1").split("\n")
    order, elements = _parse_header([line.split() for line in lines])
    names = [element.name for element in elements]
    if names.count("vertex") != 1:
        raise InputError(f"its elements are {', '.join(names) or '(none)'}; wanted exactly one named vertex")
    vertex = elements[names.index("vertex")]
    if vertex.has_list:
        raise InputError("its vertices have a list property; wanted scalars: x, y, z and perhaps intensity")
    return _Header(order, elements, vertex, header.end(), 2 + header[1].count(b"\n"))


def _parse_header(lines: list[list[str]]) -> tuple[str, list[_Element]]:
    """The byte order (empty: ascii) and the elements."""
    order: str | None = None
    elements: list[_Element] = []
    for number, words in enumerate(lines, 2):
        match words:
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", name, "1.0"] if name in _BYTE_ORDERS and order is None:
                order = _BYTE_ORDERS[name]
            case ["element", name, count]:
                if re.fullmatch(r"\d{1,18}", count, re.ASCII) is None:
                    raise InputError(f"line {number}: the header promises {count!r} of {name}; wanted a count >= 0")
                elements.append(_Element(name, int(count), []))
            case ["property", *rest] if elements and order is not None:
                elements[-1].properties.append(_parse_property(rest, order, number))
            case _:
                raise InputError(f"line {number} of its PLY header is not understood: {shown(_joined(words))}")
    if order is None:
        raise InputError("its PLY header has no line 'format ... 1.0'; write the file again")
    return order, elements


def _parse_property(words: list[str], order: str, number: int) -> _Property:
    match words:
        case [kind, name] if kind in _TYPES:
            return _Property(name, np.dtype(order + _TYPES[kind]))
        case ["list", length, kind, name] if kind in _TYPES and _TYPES.get(length, "f")[0] in "iu":
            return _Property(name, np.dtype(order + _TYPES[kind]), np.dtype(order + _TYPES[length]))
    raise InputError(f"line {number} of its PLY header is not understood: property {shown(_joined(words))}")


def _joined(words: list[str]) -> bytes:
    return " ".join(words).encode()


def _read_ascii(
    body: bytes, first_line: int, elements: list[_Element], vertex: _Element, roles: dict[str, int]
) -> Cloud:
    lines = whole_lines(body, first_line)
    needed = sum(element.count for element in elements)
    if len(lines) < needed:
        raise InputError(
            f"the header promises {needed:,} lines of points and the like and {len(lines):,} follow: "
            "the file is cut or its header is wrong; write or copy it again"
        )
    start = sum(element.count for element in elements[: elements.index(vertex)])
    rows = parse_rows(lines[start : start + vertex.count], len(vertex.properties))
    notes = surplus_note(len(lines) - needed, "lines", "element")
    return cloud_of_columns({role: rows[:, column] for role, column in roles.items()}, notes)


def _read_binary(content: bytes, header: _Header, roles: dict[str, int]) -> tuple[dict[str, np.ndarray], int]:
    """The vertices' columns, and the byte after the last element."""
    start, columns = header.end, dict[str, np.ndarray]()
    for element in header.elements:
        held = len(content) - start
        require_bytes(f"{element.count:,} of element {element.name}", element.count * element.least_bytes, held)
        if element is header.vertex:
            offsets = np.cumsum([0, *(p.dtype.itemsize for p in element.properties)])
            layout = {role: (element.properties[i].dtype.str, int(offsets[i])) for role, i in roles.items()}
            columns = unpack_records(content, start, element.count, element.least_bytes, layout)
        start = _end_of(element, content, start)
    return columns, start


def _end_of(element: _Element, content: bytes, start: int) -> int:
    """The byte after the last record of `element`."""
    if not element.has_list:
        return start + element.count * element.least_bytes
    for record in range(element.count):
        for p in element.properties:
            if p.length is None:
                start += p.dtype.itemsize
                continue
            if start + p.length.itemsize > len(content):
                raise _cut_in(element, record)
            (length,) = struct.unpack_from(_struct_format(p.length), content, start)
            start += p.length.itemsize + length * p.dtype.itemsize
            if length < 0 or start > len(content):
                raise _cut_in(element, record)
        if start > len(content):
            raise _cut_in(element, record)
    return start


def _struct_format(dtype: np.dtype) -> str:
    order = ">" if dtype.str[0] == ">" else "<"
    return order + dtype.char


def _cut_in(element: _Element, record: int) -> InputError:
    return InputError(
        f"it ends within {element.name} {record + 1:,} of {element.count:,}: "
        "the file is cut or damaged; write or copy it again"
    )
