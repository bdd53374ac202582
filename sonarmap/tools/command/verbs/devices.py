"""`sonarmap devices`: the OpenCL devices of this machine; `sonarmap doctor`: faults of it or the installation."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from sonarmap.kernels.errors import DeviceError
from sonarmap.tools.command.failures import MISUSE
from sonarmap.tools.command.option import RUNNING, DeviceOption, JsonOption
from sonarmap.tools.command.terminal import print_json, print_result, say


def command(
    device: DeviceOption = None,
    test: Annotated[bool, RUNNING.switch("--test", "Run all self-tests, even those done before.")] = False,
    as_json: JsonOption = False,
) -> None:
    """List the OpenCL devices, try each, and mark the one that would be used.

    Each driver is loaded in a process of its own, and each device is tried with a small kernel. A GPU is used only
    after its self-test, run before its first use: transforms, voxels, peaks and a small registration are compared with
    the processor's results.

    The exit code is 2 if no device works.
    """
    from sonarmap.kernels.device.device import choose_device, list_devices
    from sonarmap.kernels.device.trial import known_devices
    from sonarmap.tools.command.doctor import device_line

    list_devices(test, again=test)
    try:
        chosen, fault = choose_device(device).selector, None
    except DeviceError as error:
        chosen, fault = None, error
    devices = [asdict(info) for info in known_devices()]  # again, as choosing may have tested more
    if as_json:
        entries = [entry | {"works": not entry["fault"]} for entry in devices]
        print_json({"chosen": chosen, "devices": entries}, indent=2)
    else:
        for entry in devices:
            print_result(device_line(entry, chosen))
        if chosen:
            say(f"{chosen} (*) would be used; --device or PYOPENCL_CTX selects another")
    if fault and as_json:  # stdout has the printed object already
        say(str(fault), "error: ", "bold red")
        raise typer.Exit(MISUSE)
    if fault:
        raise fault


def doctor(
    out: Annotated[Path, typer.Argument(metavar="[OUT]", help="The folder for results.", show_default=False)] = Path(),
    quick: Annotated[
        bool, RUNNING.switch("--quick", "Load no library, and run no self-test; takes about a second.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Check the installation and this machine: libraries, OpenCL devices, memory, disk.

    Each is ok, a warning (part of it may not work) or wrong (something that is needed does not work). Below a fault
    stands its remedy, as a command to be copied. The exit code is 2 if anything is wrong. It works even if the other
    verbs do not start.
    """
    from sonarmap.tools.command.doctor import run

    if code := run(out, quick, as_json):
        raise typer.Exit(code)
