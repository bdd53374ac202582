"""OpenCL C: numbers as literals, included files in place, compiling, the line of a build log that names the error."""

import re
import warnings
from functools import cache
from numbers import Integral
from pathlib import Path

import numpy as np
import pyopencl as cl

from sonarmap.kernels.device.cache import LOGGER, digest, kernel_cache, recall, remember
from sonarmap.kernels.device.device_info import identity

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


def compile_program(context: cl.Context, source: str, options: tuple[str, ...]) -> cl.Program:
    """Compile OpenCL C as `Device.build` takes it, and say so if these kernels are new to the device; cl.Error if it
    fails."""
    device = context.devices[0]
    record = f"compiled-{digest(*identity(device), str(kernel_cache()), kernels_digest())}"
    if not recall(record):
        name = device.name.strip()
        LOGGER.info(f"compiling kernels for {name}, once: this takes some seconds")
        remember(record, {"device": name})
    program = cl.Program(context, complete(source))
    with warnings.catch_warnings():  # tests/kernels/device/test_compiled.py shows what compilers warn of
        warnings.simplefilter("ignore", cl.CompilerWarning)
        return program.build([*options])


@cache
def kernels_digest() -> str:
    """What tells these kernels from those of another version: their sources."""
    files = sorted(path for suffix in ("*.cl", "*.py") for path in KERNEL_FOLDER.rglob(suffix))
    return digest(*(path.read_text(encoding="utf-8") for path in files))


def complete(source: str) -> str:
    """What a compiler gets: the source with its includes in place, and no warning asked for that is of no use."""
    return _QUIET + _inline_includes(source)


def _inline_includes(source: str) -> str:
    """The source with each `#include "x.cl"` in place: drivers differ in how they read an include path that holds a
    space."""
    return _INCLUDE.sub(
        lambda include: _inline_includes((KERNEL_FOLDER / include[1]).read_text(encoding="utf-8")), source
    )


def informative_line(error: str) -> str:
    """The most informative line of an error's text: the first with 'error' in it, else the last of the log."""
    lines = [line.strip() for line in error.splitlines()]
    lines = [line for line in lines if line and not line.startswith(_NOT_LOG)]
    return next((line for line in lines if "error" in line.lower()), lines[-1] if lines else "it gave no reason")
