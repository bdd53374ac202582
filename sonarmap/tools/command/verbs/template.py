"""`sonarmap template`: a table of the scans, to be filled in with what instruments measured."""

from pathlib import Path
from typing import Annotated

import typer

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.option import OUTPUT, value_option
from sonarmap.tools.command.progress import growing_progress
from sonarmap.tools.command.survey import InputsArgument
from sonarmap.tools.command.terminal import printable, say, warn


def command(
    inputs: InputsArgument,
    out: Annotated[Path, value_option(OUTPUT, "FILE", "CSV file to write.", "-o", "--out")],
) -> None:
    """Write a CSV file for `--priors`: one row per scan with its name and stamp, and empty cells to fill in.

    An empty cell was not measured; columns that nobody measured may be deleted. Standard deviations may be left empty
    if --prior-sigmas gives them.
    """
    from sonarmap.tools.files.readers.scans import read_survey
    from sonarmap.tools.files.writers.atomic import require_writable
    from sonarmap.tools.files.writers.tables import require_new, write_template

    require_new(out)
    require_writable(out.parent)
    with growing_progress("reading") as step:
        read = read_survey(inputs, progress=step)
    for note in read.notes:
        say(note)
    for unread in read.unread:
        warn(f"left out: {unread.reason}")
    if not read.scans:
        raise InputError(f"{read.unread[0].reason} (no scan can be read)")
    write_template(out, [scan.name for scan in read.scans], [scan.stamp for scan in read.scans])
    typer.echo(f"{counted(len(read.scans), 'scan')}; written to {printable(str(out))}")
