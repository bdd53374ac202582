"""Parsing of numbers in rows (lines of text and packed binary records), text clouds, and checks of claimed sizes."""

import re
from array import array
from codecs import BOM_UTF8
from collections.abc import Mapping, Sequence
from contextlib import suppress
from itertools import accumulate, compress, takewhile

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds.cloud import LONGITUDES, Cloud, cloud_of_columns, column_roles

Line = tuple[int, bytes]  # its number in the file, from 1, and its content
_LARGEST_RECORD = 1 << 20  # bytes of one point
# Limits of plausible decompression. Real points compress by a factor of a few, mostly empty clouds by 100, and constant
# arrays by 1000, which are accepted up to _SMALL.
_SMALL = 64 << 20  # bytes that any file may unpack to
_RATIO = 100  # largest ratio of unpacked to packed bytes beyond that
_PLAIN = b"0123456789+-.eEnaifNAIF \t"  # other characters are not left to np.loadtxt, which accepts too much
_COMMENT = re.compile(rb"\s*(#|%|//)[#%/ \t]*")
_UNIT = re.compile(r"[\[(]")  # start of a unit in a column's name
_NOT_FINITE = re.compile(rb"[+-]?(?:1\.#\w+|nan\(\w*\))", re.IGNORECASE)  # as Microsoft's C library writes it
_COMMA = re.compile(rb"(?<![\d.,])(\d*),(\d+)(?![\d.,])")  # a decimal one, within a line
_DECIMAL = re.compile(rb"[+-]?(?:\d*(?:,\d+)?(?:e[+-]?\d+)?|nan|inf)", re.IGNORECASE)  # with a comma, or none
_COLORS = ("r", "g", "b")
_BARE: dict[int, tuple[str, ...]] = {3: ("x", "y", "z"), 4: ("x", "y", "z", "strength")}
_BARE |= {6: (*_BARE[3], *_COLORS), 7: (*_BARE[4], *_COLORS)}
_WANTED = "x y z or x y z strength, each perhaps with r g b, or a first line that names the columns: x,y,z,intensity"


def whole_lines(text: bytes, first: int) -> list[Line]:
    """The lines of `text` that are not blank, numbered from `first`, without a byte-order mark; NaN and infinity of any
    spelling become nan."""
    if text and not text.endswith((b"\n", b"\r")):
        raise InputError("the last line does not end with a line break: is the file cut? write it again, or add one")
    text = text.removeprefix(BOM_UTF8)
    lines = (_NOT_FINITE.sub(b"nan", text) if b".#" in text or b"(" in text else text).splitlines()
    return list(compress(enumerate(lines, first), map(bytes.strip, lines)))


def parse_rows(
    lines: Sequence[Line], columns: int, separator: bytes | None = None, comment: re.Pattern[bytes] | None = None
) -> np.ndarray:
    """The numbers (N, columns) float64 of `lines` that do not match `comment`; a `separator` of None is any run of
    blanks."""
    rows = [line for _, line in lines]
    if any(rows) and not b"".join(rows).translate(None, _PLAIN + (separator or b"")):
        with suppress(ValueError):
            table = np.loadtxt(rows, delimiter=(separator or b"").decode() or None, comments=None, ndmin=2)
            if table.shape == (len(rows), columns):
                return table
    numbers = array("d")
    for number, line in lines:
        if comment and comment.match(line):
            continue
        tokens = line.split(separator)
        if len(tokens) != columns:
            raise InputError(f"line {number} has {len(tokens)} columns; wanted {columns}; fix that line")
        bad = next((token for token in tokens if not is_number(token)), None)
        if bad is not None:
            remedy = (
                "write its decimal comma as a point" if _separator(bad) is None and b"," in bad else "fix that line"
            )
            raise InputError(f"line {number}: {shown(bad)} is not a number; {remedy}")
        numbers.extend(map(float, tokens))
    return np.frombuffer(numbers, np.float64).reshape(-1, columns)


def is_number(token: bytes) -> bool:
    """Whether `token` is a number, NaN or infinity."""
    with suppress(ValueError):
        float(token)
        return b"_" not in token  # only Python accepts 1_000
    return False


def shown(token: bytes) -> str:
    text = token[:40].decode("utf-8", "replace").strip()
    return repr(text + "..." if len(token) > 40 else text)


def unpack_records(
    content: bytes, start: int, count: int, fields: Sequence[tuple[str, int]], roles: Mapping[str, int]
) -> dict[str, np.ndarray]:
    """Columns {role: (count,)} of packed records that begin at byte `start`. `fields`: dtype and size [bytes] of each
    field of a record; `roles`: {role: index} of the fields to return."""
    offsets = [0, *accumulate(size for _, size in fields)]
    stride = offsets[-1]
    if stride > _LARGEST_RECORD:
        raise InputError(f"the header promises points of {stride:,} bytes; wanted up to {_LARGEST_RECORD:,}")
    require_bytes(f"{count:,} points of {stride} bytes", count * stride, len(content) - start)
    formats = [fields[field][0] for field in roles.values()]
    places = [offsets[field] for field in roles.values()]
    layout = np.dtype({"names": list(roles), "formats": formats, "offsets": places, "itemsize": stride})
    records = np.frombuffer(content, layout, count, start)
    return {role: records[role] for role in roles}


def require_bytes(what: str, needed: int, held: int) -> None:
    """Raise InputError if a header promises more bytes than follow it."""
    require(f"{what}, {needed:,} bytes, but only {max(held, 0):,} bytes follow", needed, held)


def require(promised: str, needed: int, held: int) -> None:
    """Raise InputError if `needed` is more than `held`; `promised` says in words what the header promises."""
    if needed > held:
        remedy = "the file is cut or its header is wrong; write or copy it again"
        raise InputError(f"the header promises {promised}: {remedy}")


def surplus_note(count: int, what: str, last: str) -> list[str]:
    """A list with a note about `count` lines or bytes after the last point or element; empty for a count of 0."""
    return [f"ignored {count:,} {what} after the last {last}"] if count else []


def most_unpacked(packed: int) -> int:
    """The largest plausible size of unpacked data [bytes] for a packed size."""
    return max(_SMALL, _RATIO * packed)


def require_believable(what: str, packed: int, plain: int) -> None:
    """Raise InputError if `what` claims a size in memory, `plain` [bytes], out of proportion to its size in the file,
    `packed` [bytes]."""
    if plain > most_unpacked(packed):
        raise InputError(f"{what} would make {plain:,} bytes of {packed:,}: save the file without compression")


def read_text(content: bytes) -> list[Cloud]:
    """The points of a text file. A .pts file begins with their number."""
    try:
        content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise InputError(f"line {line} is not UTF-8 text; save the file as UTF-8") from error
    lines = whole_lines(content, 1)
    comments = list(takewhile(lambda line: _COMMENT.match(line[1]), lines))
    rows, notes = lines[len(comments) :], list[str]()
    if len(rows) > 1 and re.fullmatch(rb"\s*\d{1,18}\s*", rows[0][1]):
        count, held = int(rows[0][1]), len(rows) - 1
        require(f"{count:,} points in its first line, and {held:,} lines follow", count, held)
        rows, notes = rows[1 : count + 1], surplus_note(held - count, "lines", "point")
    if not rows:
        raise InputError(f"no points among its {len(lines):,} lines; wanted lines of {_WANTED}")
    if rows[0][1].lower().startswith(b"ncols"):
        raise InputError("it is an ESRI ASCII grid of heights; wanted the scans that a sonar measured")
    names = _names_in(rows[0][1])
    separator, rows = separated(rows if names is None else rows[1:])
    if names is None:
        first, line = rows[0]
        width = len(line.split(separator))
        names = _commented_names(comments, width) or _BARE.get(width)
        if names is None:
            raise InputError(f"line {first} has {width} columns: {shown(line)}; wanted {_WANTED}")
    roles = column_roles(names)
    numbers = parse_rows(rows, len(names), separator, _COMMENT)
    colors = numbers[:, -3:]
    if names in (_BARE[6], _BARE[7]) and not ((colors == np.round(colors)) & (colors >= 0) & (colors < 256)).all():
        raise InputError(f"its last three of {len(names)} columns are no colors from 0 to 255; wanted {_WANTED}")
    return [cloud_of_columns({role: numbers[:, column] for role, column in roles.items()}, notes)]


def separated(lines: Sequence[Line]) -> tuple[bytes | None, Sequence[Line]]:
    """The separator of lines of numbers, and the lines with points for decimal commas."""
    separator = next((_separator(line) for _, line in lines if not _COMMENT.match(line)), None)
    if separator == b"," or not any(b"," in line for _, line in lines):
        return separator, lines
    return separator, [(number, _COMMA.sub(rb"\1.\2", line)) for number, line in lines]


def _separator(line: bytes) -> bytes | None:
    """The separator of a line: a semicolon, a comma that is not a decimal one, or None for any run of blanks."""
    if b";" in line:
        return b";"
    return b"," if b"," in line and not all(map(_DECIMAL.fullmatch, line.split())) else None


def _names_in(line: bytes) -> list[str] | None:
    """Column names without quotes and units (`"X [m]"` becomes X); None if none of them is a coordinate."""
    separator = _separator(line)
    tokens = [token.decode("utf-8").strip().strip("\"'") for token in line.split(separator)]
    names = [_UNIT.split(token, maxsplit=1)[0].strip() for token in tokens]
    if separator is None:
        names = [name for name in names if name]  # drop units that were separate words
    return names if {"x", "y", "z", *LONGITUDES} & {name.lower() for name in names} else None


def _commented_names(comments: list[Line], width: int) -> list[str] | None:
    """Column names in the last comment that names x, y or z and has `width` columns; None if there is none."""
    named = (_names_in(_COMMENT.sub(b"", line, count=1)) or [] for _, line in reversed(comments))
    return next((names for names in named if len(names) == width), None)
