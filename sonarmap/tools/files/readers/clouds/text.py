"""XYZ, TXT and CSV: one point per line, columns by blanks, commas or semicolons.

A header line names the columns, in any order; without one they are x y z or x y z strength. Lines that begin
with #, % or // are comments; one before the points that names as many columns as they have, x, y and z among
them, is a header too (CloudCompare writes these).
"""

import re
from itertools import takewhile

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds.cloud import Cloud, cloud_of_columns, column_roles
from sonarmap.tools.files.readers.clouds.rows import Line, is_number, parse_rows, shown, whole_lines

_COMMENT = re.compile(rb"\s*(#|%|//)[#%/ \t]*")
_UNIT = re.compile(r"[\[(]")  # how one begins
_BARE = {3: ("x", "y", "z"), 4: ("x", "y", "z", "strength")}


def read_text(content: bytes) -> list[Cloud]:
    """The points of a text file. Raises InputError: not UTF-8, a line with another number of columns (named), something
    that is no number."""
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
