"""OpenCL C source: number literals, includes, compilation, and the informative line of a build log."""

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

# Where clang does not know the widest registers of a processor, it warns of every vector that a function takes. These
# programs pass no vectors to separately compiled code, so that the warning does not matter.
_QUIET = """#ifdef __clang__
#pragma clang diagnostic ignored "-Wpsabi"
#endif
"""
_INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]+"([^"]+)"[ \t]*$', re.MULTILINE)
_NOT_LOG = ("Build on <", "(options:", "(source saved as")  # lines that PyOpenCL adds to a driver's log


def literal(value: int | float | np.number) -> str:
    """A number as an OpenCL C literal: integers exactly, others in single precision without loss."""
    return str(int(value)) if isinstance(value, Integral) else f"{float(np.float32(value))!r}f"


def compile_program(context: cl.Context, source: str, options: tuple[str, ...]) -> cl.Program:
    """Compile OpenCL C for `Device.build`, with a line in the log if these kernels are new to the device; cl.Error if
    it fails."""
    device = context.devices[0]
    if are_new(device):
        name = device.name.strip()
        LOGGER.info(f"compiling kernels for {name}, once: this takes some seconds")
        remember(_record_name(device), {"device": name})
    program = cl.Program(context, complete(source))
    with warnings.catch_warnings():  # tests/kernels/device/test_compiled.py shows what compilers warn of
        warnings.simplefilter("ignore", cl.CompilerWarning)
        return program.build([*options])


def are_new(device: cl.Device) -> bool:
    """Whether these kernels were never compiled for the device, or its driver keeps them in another folder now."""
    return not recall(_record_name(device))


def _record_name(device: cl.Device) -> str:
    return f"compiled-{digest(*identity(device), str(kernel_cache()), kernels_digest())}"


@cache
def kernels_digest() -> str:
    """Digest of all sources of kernels/, which identifies their version."""
    files = sorted(path for suffix in ("*.cl", "*.py") for path in KERNEL_FOLDER.rglob(suffix))
    return digest(*(path.read_text(encoding="utf-8") for path in files))


def complete(source: str) -> str:
    """The source for the compiler: includes replaced by their files, useless warnings disabled."""
    return _QUIET + _inline_includes(source)


def _inline_includes(source: str) -> str:
    """Replace each `#include "x.cl"` by the file, since drivers differ in how they parse include paths with spaces."""
    return _INCLUDE.sub(
        lambda include: _inline_includes((KERNEL_FOLDER / include[1]).read_text(encoding="utf-8")), source
    )


def informative_line(error: str) -> str:
    """The most informative line of an error's text: the first with 'error' in it, else the log's last."""
    lines = [line.strip() for line in error.splitlines()]
    lines = [line for line in lines if line and not line.startswith(_NOT_LOG)]
    return next((line for line in lines if "error" in line.lower()), lines[-1] if lines else "it gave no reason")
