"""`sonarmap view`: a finished map's report in the browser."""

from pathlib import Path
from typing import Annotated

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.options.option import RUNNING, switch
from sonarmap.tools.command.terminal import printable
from sonarmap.tools.files.writers.folder_lock import locked


def command(
    source: Annotated[Path, typer.Argument(help="The folder that `sonarmap map` wrote.", metavar="OUT")],
    write: Annotated[
        bool, switch(RUNNING, "--write", "Write OUT/report.html anew first. It is made from the map's files.")
    ] = False,
    show: Annotated[bool, switch(RUNNING, "--open/--no-open", "Open the report in the browser.")] = True,
) -> None:
    """Open a finished map's report, OUT/report.html, in the browser.

    The report is one file with the map in 3D, the track, the loops with their reasons and the settings. It needs no
    network and no other file, so it can be copied and sent. `--write --no-open` writes it where there is no
    browser.
    """
    from sonarmap.tools.files.map_folder.names import REPORT

    if write:
        from sonarmap.tools.files.map_folder.folder import read_map_folder
        from sonarmap.tools.products.report.page.page import write_report

        with locked(source, writing=True):
            write_report(read_map_folder(source))
        typer.echo(f"written to {printable(str(source))}: {REPORT}")
    report = _report_in(source)
    if show:
        _open(report)


def _report_in(folder: Path) -> Path:
    """The report of a map's folder. Raises InputError: there is none."""
    from sonarmap.tools.files.map_folder.names import REPORT, SUMMARY

    if (folder / REPORT).is_file():
        return folder / REPORT
    if not (folder / SUMMARY).is_file():
        raise InputError(
            f"{folder} is not a folder that `sonarmap map` wrote: it has no {SUMMARY}. Give the folder after -o"
        )
    raise InputError(
        f"{folder} has no {REPORT}, as of a map made with --no-report or by an earlier version; "
        f"`sonarmap view {folder} --write` makes it"
    )


def _open(report: Path) -> None:
    """Open a page in the browser. Raises InputError: there is no browser."""
    import webbrowser

    if not webbrowser.open(report.resolve().as_uri()):
        raise InputError(f"no browser can be opened here; open {report} in one, on this machine or another")
    typer.echo(f"opened {printable(str(report))} in the browser")
