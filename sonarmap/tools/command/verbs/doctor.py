"""`sonarmap doctor`: what is wrong with this machine or this installation, and what to do about it."""

from pathlib import Path
from typing import Annotated

import typer

from sonarmap.tools.command.option import RUNNING, JsonOption


def command(
    out: Annotated[
        Path, typer.Argument(metavar="[OUT]", help="The folder that results are to go to.", show_default=False)
    ] = Path(),
    quick: Annotated[
        bool, RUNNING.switch("--quick", "Load no library, and run no self-test; takes about a second.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Check the installation and this machine: libraries, OpenCL devices, memory, disk.

    Each is ok, a warning (part of it may not work) or wrong (something that is needed does not work), with what was
    seen and what to do, as a command that can be copied. The exit code is 2 if anything is wrong. It works where
    the other verbs do not start.
    """
    from sonarmap.tools.command.doctor import run

    if code := run(out, quick, as_json):
        raise typer.Exit(code)
