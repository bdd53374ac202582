"""XYZ, TXT and CSV: one point per line, columns by blanks, commas, semicolons or tabs.

A header line names the columns, in any order; without one they are x y z or x y z strength. Lines that begin
with #, % or // are comments; one before the points that names as many columns as they have, x, y and z among
them, is a header too (CloudCompare writes these).
"""

import re

from kernels.errors import InputError
from tools.readers.cloud import Cloud, cloud_of_columns, column_roles
from tools.readers.rows import Line, is_number, parse_rows, shown, whole_lines

_COMMENT = re.compile(rb"\s*(#|%|//)[#%/ \t]*")
_UNIT = re.compile(r"\s*[\[(].*$")
_BARE = {3: ("x", "y", "z"), 4: ("x", "y", "z", "strength")}


def read_text(content: bytes) -> list[Cloud]:
    """The points of a text file.

    Raises:
        InputError: not UTF-8, a line with another number of columns (named), something that is no number.
    """
    try:
        content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise InputError(f"line {line} is not UTF-8 text; save the file as UTF-8") from error
    lines = whole_lines(content.removeprefix(b"\xef\xbb\xbf"), 1)
    comments = [line for line in lines if _COMMENT.match(line[1])]
    rows = [line for line in lines if not _COMMENT.match(line[1])]
    if not rows:
        raise InputError(f"no points among its {len(lines):,} lines; wanted lines of x y z or x y z strength")
    separator = _separator(rows[0][1])
    width = len(rows[0][1].split(separator))
    names = _header_names(rows[0][1].split(separator))
    if names is not None:
        rows = rows[1:]
    else:
        names = _commented_names(comments, rows[0], width) or _BARE.get(width)
    if names is None:
        raise InputError(
            f"line {rows[0][0]} has {width} columns: {shown(rows[0][1])}; wanted x y z or x y z strength, or "
            "a first line that names the columns, such as: x,y,z,intensity"
        )
    roles = column_roles(names)
    numbers = parse_rows(rows, width, separator)
    return [cloud_of_columns({role: numbers[:, column] for role, column in roles.items()})]


def _separator(line: bytes) -> bytes | None:
    """Of the first line that is no comment; None is any run of blanks."""
    return next((mark for mark in (b";", b",", b"\t") if mark in line.strip()), None)


def _header_names(tokens: list[bytes]) -> list[str] | None:
    """Column names, or None where the line is a point: no coordinate is named by a number."""
    if all(is_number(token) for token in tokens):
        return None
    names = [_plain_name(token) for token in tokens]
    if not {"x", "y", "z"} & {name.lower() for name in names}:
        return None  # rather a damaged point: let the row parser name line and token
    return names


def _commented_names(comments: list[Line], first_row: Line, width: int) -> list[str] | None:
    """Of the last comment before the first point that names x, y, z and as many columns as there are."""
    for number, line in reversed(comments):
        text = _COMMENT.sub(b"", line, count=1)
        names = [_plain_name(token) for token in text.split(_separator(text))]
        if (
            number < first_row[0]
            and len(names) == width
            and {"x", "y", "z"} <= {name.lower() for name in names}
        ):
            return names
    return None


def _plain_name(token: bytes) -> str:
    """`"X [m]"` is x: quotes and units are no part of a column's name."""
    return _UNIT.sub("", token.decode("utf-8").strip().strip("\"'")).strip()
