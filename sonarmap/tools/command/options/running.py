"""The options that say where and how a command runs, and what it prints meanwhile."""

from contextlib import suppress
from typing import Annotated

from sonarmap.tools.command.options.option import RUNNING, switch, value_option


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
    value_option(
        RUNNING,
        "DEVICE",
        "OpenCL device: cpu, gpu, or a part of its name. platform:device too; `sonarmap devices` lists them.",
        "--device",
        autocompletion=_devices,
    ),
]
JsonOption = Annotated[bool, switch(RUNNING, "--json", "Print the result as JSON, without progress.")]
QuietOption = Annotated[bool, switch(RUNNING, "--quiet -q", "Print nothing but warnings and errors.")]
