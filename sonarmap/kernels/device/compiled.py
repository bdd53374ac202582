# pyright: strict, reportUnknownMemberType=false, reportUnknownVariableType=false
"""Compiling is no secret: that it takes seconds the first time, and what the compiler warned of, each said once."""

import re
import warnings

import pyopencl as cl

from sonarmap.kernels.device.cache import LOGGER, digest, kernel_cache, recall, remember
from sonarmap.kernels.device.source import complete

_KEPT = 1000  # programs that are remembered of a device
_WARNING = re.compile(r"\bwarning\b", re.IGNORECASE)
_PLACE = re.compile(r"\S*[/\\]\S+?\.cl:|<source>:|^\d+:(?=\d+:\d+:)")  # drivers keep the source in a file of their own
_said: set[tuple[str, ...]] = set()


def compile_program(context: cl.Context, source: str, options: tuple[str, ...], name: str) -> cl.Program:
    """Compile OpenCL C as `Device.build` takes it, and say so if it is the first time on this machine.

    Raises:
        cl.Error: it does not build.
    """
    device, whole = context.devices[0], complete(source)
    record = f"compiled-{digest(*identity(device), str(kernel_cache()))}"
    known, key = recall(record).get("programs", []), digest(whole, *options)
    if key not in known and (record,) not in _said:
        _said.add((record,))
        LOGGER.info(f"compiling kernels for {device.name.strip()}, once: this takes some seconds")
    program = cl.Program(context, whole)
    with warnings.catch_warnings():  # PyOpenCL says only that there is a log
        warnings.simplefilter("ignore", cl.CompilerWarning)
        program.build([*options])
    if key not in known:
        _show_warnings(program, device.name.strip(), name)
        remember(record, {"programs": [*known, key][-_KEPT:]})
    return program


def identity(device: cl.Device) -> tuple[str, str, str]:
    """What tells a device with its driver from others: name, platform, driver."""
    return device.name.strip(), device.platform.version.strip(), device.driver_version.strip()


def build_warnings(program: cl.Program) -> list[str]:
    """The lines of a program's build log that warn."""
    logs = [program.get_build_info(device, cl.program_build_info.LOG) or "" for device in program.devices]
    log = "\n".join(map(str, logs))
    return [_PLACE.sub("line ", line.strip()) for line in log.splitlines() if _WARNING.search(line)]


def _show_warnings(program: cl.Program, device: str, name: str) -> None:
    """Log the first warning of a program; the same of another shape or edge is not shown again."""
    lines = build_warnings(program)
    if not lines or (said := (device, name, re.sub(r"\d+", "", lines[0]))) in _said:
        return
    _said.add(said)
    more = f" (and {len(lines) - 1} more)" if len(lines) > 1 else ""
    LOGGER.warning(
        f"the OpenCL compiler of {device} warns of the program '{name}': {lines[0]}{more}. It is not an error: the "
        "program runs, if slower than it could. 'sonarmap devices --test' shows whether its numbers are right."
    )
