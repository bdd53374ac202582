"""`sonarmap devices`: the OpenCL devices of this machine, and the one that would be used."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from sonarmap.kernels.errors import DeviceError
from sonarmap.tools.command.failures import MISUSE
from sonarmap.tools.command.options.option import RUNNING, switch
from sonarmap.tools.command.options.running import DeviceOption, JsonOption
from sonarmap.tools.command.terminal import number_table, print_json, printable, result_console, say

# Of the grids those whose edge is a multiple of this are shown.
_SHOWN = 32

if TYPE_CHECKING:
    from sonarmap.kernels.device.device import DeviceInfo


def command(
    device: DeviceOption = None,
    test: Annotated[bool, switch(RUNNING, "--test", "Run all self-tests, even those done before.")] = False,
    as_json: JsonOption = False,
) -> None:
    """List the OpenCL devices, try each, and mark the one that would be used.

    Each driver is loaded in a process of its own, and each device tried with a small kernel. A GPU is used only after
    its self-test, which is run before its first use: transforms, voxels, peaks and a small registration, compared with
    the processor's numbers. Below stands how much of a device's memory each grid needs.

    The exit code is 2 if no device works.
    """
    from sonarmap.kernels.device.device import choose_device, list_devices
    from sonarmap.kernels.device.trial import known_devices

    list_devices(test, again=test)
    try:
        chosen, fault = choose_device(device).selector, None
    except DeviceError as error:
        chosen, fault = None, error
    infos = known_devices()  # just tried, and the choice may have tested some more
    if as_json:
        entries = [asdict(info) | {"works": not info.fault} for info in infos]
        print_json({"chosen": chosen, "devices": entries, "grids": _needs()}, indent=2)
    else:
        _print_table(infos, chosen)
        _print_needs()
    if fault and as_json:  # what failed stands in the object that is printed
        say(str(fault), "error: ", "bold red")
        raise typer.Exit(MISUSE)
    if fault:
        raise fault


def _print_table(infos: "list[DeviceInfo]", chosen: str | None) -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2))
    for info in infos:
        state = ("does not work: " + printable(info.fault), "red") if info.fault else ("works", "green")
        if info.compute_units:
            driver, memory = info.version.rpartition(", ")[2], f"{info.memory / 2**30:.1f} GiB"
            described = f"{printable(info.name)}: {info.kind}, {info.compute_units} units, {memory}\n"
            described += f"{printable(f'{info.platform} ({driver})')}\nself-test {info.self_test}; "
        else:
            described = f"driver {printable(info.driver_file or info.name)}\n"
        table.add_row("→" if info.selector == chosen else "", info.selector, Text.assemble(described, state))
    result_console().print(table)
    if chosen:
        say(f"{chosen} would be used; --device or PYOPENCL_CTX selects another")


def _needs() -> list[dict[str, int]]:
    """What a pair of scans takes on each grid, of the default method [bytes]."""
    from sonarmap.kernels.fft.edges import EDGES
    from sonarmap.spectral.memory import POINTS, memory_plan

    plans = [memory_plan(edge) for edge in EDGES]
    return [
        {"grid": plan.edge, "points": POINTS, "pair": plan.pair, "scan": plan.scan, "largest": plan.largest}
        for plan in plans
    ]


def _print_needs() -> None:
    table = number_table("grid", "a pair needs", "each more prepared scan", "largest array", words=1)
    for need in _needs():
        if need["grid"] % _SHOWN:
            continue
        table.add_row(f"{need['grid']}^3", *(f"{need[name] / 2**20:.0f} MiB" for name in ("pair", "scan", "largest")))
    result_console().print(table)
