"""Numbers in rows: lines of text, and packed binary records; and how many bytes are believable."""

import re
from array import array
from collections.abc import Mapping, Sequence
from contextlib import suppress
from itertools import accumulate, compress, takewhile

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds.cloud import Cloud, cloud_of_columns, column_roles

Line = tuple[int, bytes]  # its number in the file, from 1, and its content
_LARGEST_RECORD = 1 << 20  # bytes of one point
# Real points shrink a few times, clouds of which most is missing a hundred times, and an array of one value a thousand
# times: a small one is not refused for that.
_SMALL = 64 << 20
_RATIO = 100
_PLAIN = b"0123456789+-.eEnaifNAIF \t"  # NumPy splits lines at, and makes numbers of, more than these files mean
_COMMENT = re.compile(rb"\s*(#|%|//)[#%/ \t]*")
_UNIT = re.compile(r"[\[(]")  # how one begins
_BARE = {3: ("x", "y", "z"), 4: ("x", "y", "z", "strength")}


def whole_lines(text: bytes, first: int) -> list[Line]:
    """The lines of `text` that are not blank, numbered from `first`."""
    if text and not text.endswith((b"\n", b"\r")):
        raise InputError(
            "the last line does not end with a line break, so the file may have been cut within a number; "
            "write it again, or add a line break at its end if it is whole"
        )
    lines = text.splitlines()
    return list(compress(enumerate(lines, first), map(bytes.strip, lines)))


def parse_rows(
    lines: Sequence[Line], columns: int, separator: bytes | None = None, comment: re.Pattern[bytes] | None = None
) -> np.ndarray:
    """The numbers of `lines` as (N, columns) float64, without lines that match `comment`; `separator` None is any run
    of blanks."""
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
            raise InputError(f"line {number}: {shown(bad)} is not a number; fix that line")
        numbers.extend(map(float, tokens))
    return np.frombuffer(numbers, np.float64).reshape(-1, columns)


def is_number(token: bytes) -> bool:
    """Whether `token` is a number as these files write it (NaN and inf are)."""
    with suppress(ValueError):
        float(token)
        return b"_" not in token  # 1_000 is a number to Python, to nobody else
    return False


def shown(token: bytes) -> str:
    text = token[:40].decode("utf-8", "replace").strip()
    return repr(text + "..." if len(token) > 40 else text)


def unpack_records(
    content: bytes, start: int, count: int, fields: Sequence[tuple[str, int]], roles: Mapping[str, int]
) -> dict[str, np.ndarray]:
    """Columns of `count` packed records, from byte `start` on: {role: (count,)}. `fields` are dtype and bytes of each
    field of a record, `roles` those that are wanted."""
    offsets = [0, *accumulate(size for _, size in fields)]
    stride = offsets[-1]
    if stride > _LARGEST_RECORD:
        raise InputError(
            f"the header promises points of {stride:,} bytes each; wanted at most {_LARGEST_RECORD:,}: it is damaged, "
            "write or copy the file again"
        )
    require_bytes(f"{count:,} points of {stride} bytes", count * stride, len(content) - start)
    formats = [fields[field][0] for field in roles.values()]
    places = [offsets[field] for field in roles.values()]
    layout = np.dtype({"names": list(roles), "formats": formats, "offsets": places, "itemsize": stride})
    records = np.frombuffer(content, layout, count, start)
    return {role: records[role] for role in roles}


def require_bytes(what: str, needed: int, held: int) -> None:
    """Refuse a header that promises more bytes than the file holds after it."""
    require(f"{what}, {needed:,} bytes, but only {max(held, 0):,} bytes follow", needed, held)


def require(promised: str, needed: int, held: int) -> None:
    """Refuse a header that promises more than the file holds after it, both in words."""
    if needed > held:
        remedy = "the file is cut or its header is wrong; write or copy it again"
        raise InputError(f"the header promises {promised}: {remedy}")


def surplus_note(count: int, what: str, last: str) -> list[str]:
    """A note about `count` lines or bytes after the last point or element; none if there are none."""
    return [f"ignored {count:,} {what} after the last {last}"] if count else []


def most_unpacked(packed: int) -> int:
    """To how many bytes some compressed ones may believably unpack."""
    return max(_SMALL, _RATIO * packed)


def require_believable(what: str, packed: int, plain: int) -> None:
    """Refuse what would take memory out of all proportion to the file: `plain` bytes in memory, of `packed` ones in the
    file, that `what` claims."""
    if plain > most_unpacked(packed):
        raise InputError(
            f"{what} would make {plain:,} bytes of {packed:,}, which is not believable: the file is damaged, copy it "
            "again; if it is right, save it without compression"
        )


def read_text(content: bytes) -> list[Cloud]:
    """The points of a text file."""
    try:
        content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise InputError(f"line {line} is not UTF-8 text; save the file as UTF-8") from error
    lines = whole_lines(content.removeprefix(b"\xef\xbb\xbf"), 1)
    comments = list(takewhile(lambda line: _COMMENT.match(line[1]), lines))
    rows = lines[len(comments) :]
    if not rows:
        raise InputError(f"no points among its {len(lines):,} lines; wanted lines of x y z or x y z strength")
    first, line = rows[0]
    separator = _separator(line)
    width = len(line.split(separator))
    names = None if all(map(is_number, line.split(separator))) else _names_in(line, separator)
    if names is not None:
        rows, width = rows[1:], len(names)
    else:
        names = _commented_names(comments, width) or _BARE.get(width)
    if names is None:
        raise InputError(
            f"line {first} has {width} columns: {shown(line)}; wanted x y z or x y z strength, or a first "
            "line that names the columns, such as: x,y,z,intensity"
        )
    roles = column_roles(names)
    numbers = parse_rows(rows, width, separator, _COMMENT)
    return [cloud_of_columns({role: numbers[:, column] for role, column in roles.items()})]


def _separator(line: bytes) -> bytes | None:
    """Of the first line that is no comment; None is any run of blanks."""
    return next((mark for mark in (b";", b",") if mark in line), None)


def _names_in(line: bytes, separator: bytes | None) -> list[str] | None:
    """The columns' names without quotes and units (`"X [m]"` is X); None where not one is x, y or z."""
    tokens = [token.decode("utf-8").strip().strip("\"'") for token in line.split(separator)]
    names = [_UNIT.split(token, maxsplit=1)[0].strip() for token in tokens]
    if separator is None:
        names = [name for name in names if name]  # a unit that stood alone
    return names if {"x", "y", "z"} & {name.lower() for name in names} else None


def _commented_names(comments: list[Line], width: int) -> list[str] | None:
    """Of the last comment that names x, y or z, and as many columns as there are."""
    texts = (_COMMENT.sub(b"", line, count=1) for _, line in reversed(comments))
    named = (_names_in(text, _separator(text)) or [] for text in texts)
    return next((names for names in named if len(names) == width), None)
