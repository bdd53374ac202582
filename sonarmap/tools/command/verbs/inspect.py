"""`sonarmap inspect`: the contents of scan files and navigation logs, before a map is made."""

from pathlib import Path
from typing import Annotated

import typer

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.failures import as_options
from sonarmap.tools.command.method import DEFAULT_EDGE, GridOption
from sonarmap.tools.command.navigation import NavigationReading
from sonarmap.tools.command.option import OUTPUT, JsonOption, QuietOption, given
from sonarmap.tools.command.survey import InputsArgument, PointReading
from sonarmap.tools.command.terminal import growing_progress, print_json, say, warn

INCOMPLETE = 3


def command(
    inputs: InputsArgument,
    points: PointReading,
    reading: NavigationReading,
    grid: GridOption = None,
    template: Annotated[
        Path | None, OUTPUT.value("FILE", "Write a CSV table of the scans for --priors, to be filled in.", "--template")
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Show the contents of scan files: number of scans, their extent, times and rate, missing or damaged data, and the
    voxels that suit them.

    Only one scan at a time is in memory. The exit code is 3 if a file or scan cannot be read, 2 if none can.

    If the first INPUT is a log of navigation (CSV, NMEA 0183, TUM), it shows the log's contents and lists rejected
    rows with their line numbers; if scans follow, also how many of them the log covers. The exit code is 3 if no row
    matches a scan.

    --template writes a row for each scan with its name and stamp, and empty cells for measurements. Cells without a
    measurement stay empty; columns without any may be deleted. --prior-sigmas gives the standard deviations that the
    table lacks.
    """
    from sonarmap.tools.command.overview import overview_json, overview_of, print_overview
    from sonarmap.tools.files.readers.navigation.overview import is_log
    from sonarmap.tools.files.writers.atomic import require_writable
    from sonarmap.tools.files.writers.tables import require_new, write_template

    if template is not None:
        require_new(template)
        require_writable(template.parent)
    if is_log(path := Path(inputs[0])):
        if template is not None:
            raise InputError(f"--template {template} is for scans, and {path} is a log of navigation")
        if not _inspect_log(path, inputs[1:], points, reading, as_json, quiet):
            raise typer.Exit(INCOMPLETE)
        return
    for flag, value in given(reading).items():
        raise InputError(f"--{flag.replace('_', '-')} {value} needs a log of navigation; give one as the first INPUT")
    with growing_progress("reading", quiet or as_json) as step:
        overview = overview_of(inputs, points.corrections(), grid or DEFAULT_EDGE, step)
    if template is not None:
        write_template(template, overview.names, overview.stamps)
        say(f"written to {template}: {counted(len(overview.names), 'row')}")
    if as_json:
        print_json(overview_json(overview))
    else:
        print_overview(overview)
        for note in overview.notes:
            say(as_options(note))
    for reason in overview.unread:
        warn(f"cannot be read: {as_options(reason)}")
    if overview.unread:
        raise typer.Exit(INCOMPLETE)


def _inspect_log(
    path: Path,
    scans: list[str],
    points: PointReading,
    reading: NavigationReading,
    as_json: bool,
    quiet: bool,
) -> bool:
    """Print a log's overview; return whether it covers some of the scans, or there are none."""
    import numpy as np

    from sonarmap.tools.command.overview import log_json, print_log
    from sonarmap.tools.files.readers.navigation.overview import log_overview

    settings = reading.settings(path)
    stamps = np.zeros(0)
    if scans:
        from sonarmap.tools.files.readers.scans import read_survey

        with growing_progress("reading", quiet or as_json) as step:
            stamps = np.array([scan.stamp for scan in read_survey(scans, [], step, points.corrections()).scans])
    overview = log_overview(path, settings, stamps)
    if as_json:
        print_json(log_json(overview))
    else:
        print_log(overview)
        for note in overview.notes:
            say(note)
    if overview.apart:
        warn(f"{path}: no row is at the time of a scan, or near it: {overview.apart}")
    return not overview.apart
