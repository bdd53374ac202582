"""The options that say where and how a command runs, and what it prints meanwhile."""

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from sonarmap.tools.command.options.groups import RUNNING


def _devices(incomplete: str) -> list[tuple[str, str]]:
    """What a shell completes: kinds, and the devices of this machine with their names."""
    from sonarmap.kernels.device.device import device_names
    from sonarmap.kernels.errors import DeviceError

    known = [("cpu", "the processor"), ("gpu", "a graphics card")]
    with suppress(DeviceError):
        known += device_names()
    return [(selector, name) for selector, name in known if selector.startswith(incomplete)]


DeviceOption = Annotated[
    str | None,
    typer.Option(
        "--device",
        metavar="DEVICE",
        help="OpenCL device: cpu, gpu, or a part of its name. platform:device too; `sonarmap devices` lists them.",
        rich_help_panel=RUNNING,
        autocompletion=_devices,
    ),
]
LogFileOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        dir_okay=False,
        help="Add everything that is said, with times, to the end of FILE.",
        rich_help_panel=RUNNING,
        hidden=True,
    ),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print the result as JSON, without progress.", rich_help_panel=RUNNING)
]
QuietOption = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print nothing but warnings and errors.", rich_help_panel=RUNNING)
]
