"""OpenCL C text: numbers as literals, included files put in place, the line of a build log that names the error."""

import re
from numbers import Integral
from pathlib import Path

import numpy as np

KERNEL_FOLDER = Path(__file__).parents[1]

# No vector is handed over between these programs and others; clang, where it does not know the widest registers of a
# processor, warns of every one that is handed to a function.
_QUIET = """#ifdef __clang__
#pragma clang diagnostic ignored "-Wpsabi"
#endif
"""
_INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]+"([^"]+)"[ \t]*$', re.MULTILINE)
_NOT_LOG = ("Build on <", "(options:", "(source saved as")  # what PyOpenCL puts around a driver's log


def literal(value: int | float | np.number) -> str:
    """A number as OpenCL C: a whole one as it is, any other in single precision, read back to the same bits."""
    return str(int(value)) if isinstance(value, Integral) else f"{float(np.float32(value))!r}f"


def complete(source: str) -> str:
    """What a compiler gets: the source with its includes in place, and no warning asked for that is of no use."""
    return _QUIET + _inline_includes(source)


def _inline_includes(source: str) -> str:
    """The source with each line `#include "x.cl"` replaced by that file of this folder.

    An include path would do the same, but drivers differ in how they read a path that holds a space.
    """
    return _INCLUDE.sub(
        lambda include: _inline_includes((KERNEL_FOLDER / include[1]).read_text(encoding="utf-8")), source
    )


def informative_line(error: str) -> str:
    """The most informative line of an error's text: the first with 'error' in it, else the last of the log."""
    lines = [line.strip() for line in error.splitlines()]
    lines = [line for line in lines if line and not line.startswith(_NOT_LOG)]
    return next((line for line in lines if "error" in line.lower()), lines[-1] if lines else "it gave no reason")
