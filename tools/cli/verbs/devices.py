"""`sonarmap devices`: the OpenCL devices of this machine, and the one that would be used."""

import json
from dataclasses import asdict
from typing import TYPE_CHECKING

import typer

from kernels.errors import DeviceError
from tools.cli.options import DeviceOption, JsonOption
from tools.cli.terminal import printable, result_console, say

if TYPE_CHECKING:
    from kernels.device.device import DeviceInfo


def command(device: DeviceOption = None, as_json: JsonOption = False) -> None:
    """List the OpenCL devices, try each with a small kernel, and mark the one that would be used.

    The exit code is 2 if none works.
    """
    from kernels.device.device import choose_device, list_devices

    infos = list_devices()
    try:
        chosen, fault = choose_device(device).selector, None
    except DeviceError as error:
        chosen, fault = None, error
    if as_json:
        entries = [asdict(info) | {"works": not info.fault} for info in infos]
        typer.echo(json.dumps({"chosen": chosen, "devices": entries}, indent=2))
    else:
        _print_table(infos, chosen)
    if fault:
        raise fault


def _print_table(infos: "list[DeviceInfo]", chosen: str | None) -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table("", "device", "kind", "units", "memory", box=None, pad_edge=False)
    table.add_column("name", overflow="fold")
    table.add_column("platform", overflow="fold")
    table.add_column("state", overflow="fold")
    for info in infos:
        mark = "→" if info.selector == chosen else ""
        state = Text(f"no: {printable(info.fault)}", "red") if info.fault else Text("works", "green")
        driver = info.version.rpartition(", ")[2]
        name, platform = Text(printable(info.name)), Text(printable(f"{info.platform} ({driver})"))
        memory = f"{info.memory / 2**30:.1f} GiB"
        table.add_row(mark, info.selector, info.kind, str(info.compute_units), memory, name, platform, state)
    result_console().print(table)
    if chosen:
        say(f"{chosen} would be used; --device or PYOPENCL_CTX selects another")
