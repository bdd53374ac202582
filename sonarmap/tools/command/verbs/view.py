"""`sonarmap view`: a finished map's report in the browser."""

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.option import RUNNING
from sonarmap.tools.command.terminal import printable
from sonarmap.tools.files.writers.atomic import locked


def command(
    source: Annotated[Path, typer.Argument(help="The folder that `sonarmap map` wrote.", metavar="MAP")],
    rebuild: Annotated[bool, RUNNING.switch("--rebuild", "Make the report again first, from the map's files.")] = False,
    show: Annotated[bool, RUNNING.switch("--open/--no-open", "Open the report in the browser.")] = True,
) -> None:
    """Open a finished map's report, MAP/report.html, in the browser.

    The report is one file with the map in 3D, the track, the loops with their reasons and the settings. It needs no
    network and no other file, so it can be copied and sent. `--rebuild --no-open` writes it where there is no
    browser.
    """
    from sonarmap.tools.files.map_folder.names import REPORT, SUMMARY

    report = source / REPORT
    if rebuild:
        from sonarmap.tools.files.map_folder.folder import read_map_folder
        from sonarmap.tools.products.report.page import write_report

        with locked(source, writing=True):
            write_report(read_map_folder(source))
        typer.echo(f"written to {printable(str(source))}: {REPORT}")
    elif not report.is_file():
        if not (source / SUMMARY).is_file():
            raise InputError(
                f"{source} is not a folder that `sonarmap map` wrote: it has no {SUMMARY}. Give the one that "
                "its -o named, as in `sonarmap view map/`"
            )
        raise InputError(
            f"{source} has no {REPORT}, as of a map made with --no-report or by an earlier version; "
            f"`sonarmap view {source} --rebuild` makes it"
        )
    if show:
        if not webbrowser.open(report.resolve().as_uri()):
            raise InputError(f"no browser can be opened here; open {report} in one, on this machine or another")
        typer.echo(f"opened {printable(str(report))} in the browser")
