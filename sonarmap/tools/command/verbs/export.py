"""`sonarmap export`: a map in formats of other programs; `sonarmap view`: its report in the browser."""

import webbrowser
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.option import OUTPUT, REQUIRED, RUNNING, JsonOption, QuietOption
from sonarmap.tools.command.output import CELL, EarthPlace, FormatsOption, export_with_progress
from sonarmap.tools.command.terminal import print_json, printable
from sonarmap.tools.files.writers.atomic import locked
from sonarmap.tools.products.export.formats import HEIGHTS


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedFiles:
    """Options of the exported files."""

    out: Path = OUTPUT.option("OUT", "Folder for the files; it may be MAP itself.", REQUIRED, "-o", "--out")
    format: FormatsOption
    cell: float | None = OUTPUT.length("Edge of a grid's cell \\[m].", CELL)
    height: str = OUTPUT.choice("Height of a cell: top (mean of its uppermost surface), mean or shoalest.", HEIGHTS)
    points: str = OUTPUT.choice(
        "Points in laz, copc, e57 and xyz: map (one for each voxel of the map) or all (every point of every scan, "
        "from the scans that the map was made of).",
        ("map", "all"),
    )
    scans_from: list[str] = OUTPUT.option(
        "PATH", "Where the scans are now; may be repeated.", [], shown="where `map` read them", rare=True
    )


def command(
    source: Annotated[Path, typer.Argument(help="The folder that `sonarmap map` wrote.", metavar="MAP")],
    files: ExportedFiles,
    earth: EarthPlace,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Write a finished map in other programs' formats, placed on the Earth.

    Every file gets a FILE.json that describes it: frame, datum, CRS, vertical reference, signs, versions, settings, and
    SHA-256 of the file and of the scans. Either all files are written or none. Without --origin the map lies where
    navigation placed it. Points of scans (--points all) are read from the scans again.
    """
    from sonarmap.tools.files.map_folder.folder import read_map_folder
    from sonarmap.tools.products.export.run import ExportSettings

    settings = ExportSettings(
        formats=tuple(files.format),
        crs=earth.crs,
        cell=files.cell,
        height=files.height,
        of_scans=files.points == "all",
        scans_from=tuple(files.scans_from),
    )
    with locked(source, writing=files.out.resolve() == source.resolve()):
        folder = read_map_folder(source)
        folder = replace(folder, georeference=earth.georeference(folder.georeference))
        exported = export_with_progress(folder, files.out, settings, quiet or as_json)
    if as_json:
        print_json(asdict(exported))
    else:
        typer.echo(f"written to {printable(str(files.out))}: {', '.join(path.name for path in exported.files)}")


def view(
    source: Annotated[Path, typer.Argument(help="The folder that `sonarmap map` wrote.", metavar="MAP")],
    rebuild: Annotated[bool, RUNNING.switch("--rebuild", "Write the report again from the map's files.")] = False,
    show: Annotated[bool, RUNNING.switch("--open/--no-open", "Open the report in the browser.")] = True,
) -> None:
    """Open a finished map's report, MAP/report.html, in the browser.

    The report is one file with the map in 3D, the track, the loops with their reasons and the settings. It needs no
    network and no other file, so it can be copied and sent. `--rebuild --no-open` writes it without opening a
    browser.
    """
    from sonarmap.tools.files.map_folder.names import REPORT
    from sonarmap.tools.files.readers.csv_table import SUMMARY

    report = source / REPORT
    if rebuild:
        from sonarmap.tools.files.map_folder.folder import read_map_folder
        from sonarmap.tools.products.report.page import write_report

        with locked(source, writing=True):
            write_report(read_map_folder(source))
        typer.echo(f"written to {printable(str(source))}: {REPORT}")
    elif not report.is_file():
        if not (source / SUMMARY).is_file():
            raise InputError(f"{source} is not a folder that `sonarmap map` wrote: it has no {SUMMARY}")
        raise InputError(f"{source} has no {REPORT}; `sonarmap view {source} --rebuild` makes it")
    if show:
        if not webbrowser.open(report.resolve().as_uri()):
            raise InputError(f"no browser can be opened here; open {report} in one, on this machine or another")
        typer.echo(f"opened {printable(str(report))} in the browser")
