"""Strict reader of PLY files: ascii, and binary in both byte orders.

Elements after the vertices are read too, so that a file cut anywhere is detected.
Format: G. Turk, The PLY Polygon File Format, 1994.
"""

import re
from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds import rows
from sonarmap.tools.files.readers.clouds.cloud import Cloud, cloud_of_columns, column_roles

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
    length: np.dtype | None = None  # type of a list's length; None for a scalar


@dataclass(frozen=True, slots=True)
class _Element:
    name: str
    count: int
    properties: list[_Property]

    @property
    def least_bytes(self) -> int:
        """Bytes of a record with empty lists."""
        return sum((p.length or p.dtype).itemsize for p in self.properties)

    @property
    def has_list(self) -> bool:
        return any(p.length is not None for p in self.properties)


@dataclass(frozen=True, slots=True)
class _Header:
    """The header of a PLY file."""

    order: str  # byte order; empty for ascii
    elements: list[_Element]
    vertex: _Element  # the element of vertices
    end: int  # offset of the first byte after the header
    lines: int  # number of lines of the header


def read_ply(content: bytes) -> list[Cloud]:
    """Read the vertices of a PLY file."""
    header = _header_of(content)
    roles = column_roles([p.name for p in header.vertex.properties])
    if header.order == "":
        lines = rows.whole_lines(content[header.end :], header.lines + 1)
        counts = [element.count for element in header.elements]
        needed, held = sum(counts), len(lines)
        rows.require(f"{needed:,} lines of points and the like and {held:,} follow", needed, held)
        start = sum(counts[: header.elements.index(header.vertex)])
        separator, vertices = rows.separated(lines[start : start + header.vertex.count])
        numbers = rows.parse_rows(vertices, len(header.vertex.properties), separator)
        columns = {role: numbers[:, column] for role, column in roles.items()}
        return [cloud_of_columns(columns, rows.surplus_note(held - needed, "lines", "element"))]
    columns, start = _read_binary(content, header, roles)
    return [cloud_of_columns(columns, rows.surplus_note(len(content) - start, "bytes", "element"))]


def read_ply_columns(content: bytes) -> dict[str, np.ndarray]:
    """Read all properties {name: (N,)} of the vertices of a binary PLY file, in their types."""
    header = _header_of(content)
    if header.order == "":
        raise InputError("it is an ascii PLY file; wanted a binary one, as `sonarmap map` writes")
    return _read_binary(content, header, {p.name: k for k, p in enumerate(header.vertex.properties)})[0]


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
    """The byte order (empty for ascii) and the elements."""
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
                    given = f"{rows.shown(count.encode())} of {name[:40]}"
                    raise InputError(f"line {number}: the header promises {given}; wanted a count >= 0")
                elements.append(_Element(name, int(count), []))
            case ["property", kind, name] if elements and order is not None and kind in _TYPES:
                elements[-1].properties.append(_Property(name, np.dtype(order + _TYPES[kind])))
            case ["property", "list", length, kind, name] if (
                elements and order is not None and kind in _TYPES and _TYPES.get(length, "f")[0] in "iu"
            ):
                kinds = np.dtype(order + _TYPES[kind]), np.dtype(order + _TYPES[length])
                elements[-1].properties.append(_Property(name, *kinds))
            case _:
                # keep the word "property" if the property itself is at fault
                known = "property " * (words[0] == "property" and bool(elements) and order is not None)
                rest = rows.shown(" ".join(words[1:] if known else words).encode())
                raise InputError(f"line {number} of its PLY header is not understood: {known}{rest}")
    if order is None:
        raise InputError("its PLY header has no line 'format ... 1.0'; write the file again")
    return order, elements


def _read_binary(content: bytes, header: _Header, roles: dict[str, int]) -> tuple[dict[str, np.ndarray], int]:
    """Columns (N,) of the vertices by role, and the offset of the first byte after the last element."""
    start, columns = header.end, dict[str, np.ndarray]()
    for element in header.elements:
        held = len(content) - start
        rows.require_bytes(f"{element.count:,} of element {element.name}", element.count * element.least_bytes, held)
        if element is header.vertex:
            fields = [(p.dtype.str, p.dtype.itemsize) for p in element.properties]
            columns = rows.unpack_records(content, start, element.count, fields, roles)
        start = _end_of(element, content, start)
    return columns, start


def _end_of(element: _Element, content: bytes, start: int) -> int:
    """Offset of the first byte after the last record of `element`."""
    if not element.has_list:
        return start + element.count * element.least_bytes
    for record in range(element.count):
        for p in element.properties:
            length = 1
            if p.length is not None:
                counter = content[start : start + p.length.itemsize]
                order = "big" if p.length.str[0] == ">" else "little"
                length = int.from_bytes(counter, order, signed=p.length.kind == "i")
                start += p.length.itemsize
            start += length * p.dtype.itemsize
            if length < 0 or start > len(content):
                raise InputError(f"it ends within {element.name} {record + 1:,} of {element.count:,}: copy it again")
    return start
