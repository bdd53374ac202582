"""`sonarmap export`: a finished map to the formats of other programs."""

import json
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from sonarmap.tools.command.options.option import OUTPUT, REQUIRED, option
from sonarmap.tools.command.options.output import EarthPlace, FormatsOption, export_with_progress
from sonarmap.tools.command.options.registration import checked, is_positive
from sonarmap.tools.command.options.running import JsonOption, QuietOption
from sonarmap.tools.command.terminal import printable
from sonarmap.tools.files.writers.folder_lock import locked

_output = partial(option, OUTPUT)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedFiles:
    """Which files are written, and where."""

    to: Path = _output("DIR", "Folder for the files; it may be OUT itself.", REQUIRED)
    format: FormatsOption
    cell: float | None = _output(
        "M",
        "Edge of a grid's cell \\[m].",
        callback=checked(is_positive, "{} m; give a length above 0, or leave it out for the map's voxel"),
        shown="the map's voxel",
    )
    rate: float | None = _output(
        "HZ",
        "Poses a second in files of poses \\[Hz].",
        callback=checked(is_positive, "{} Hz; give a rate above 0, or leave it out for the scans'"),
        rare=True,
    )


def command(
    source: Annotated[Path, typer.Argument(help="The folder that `sonarmap map` wrote.", metavar="OUT")],
    files: ExportedFiles,
    earth: EarthPlace,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Write a finished map in other programs' formats, placed on the Earth.

    Beside every file a second one, FILE.json, says what it is: frame, datum, CRS, vertical reference, signs, versions,
    settings, and SHA-256 of the file and of the scans. All files appear together, or none. Without --origin the map
    lies where navigation placed it.
    """
    from sonarmap.tools.files.map_folder.folder import read_map_folder
    from sonarmap.tools.products.export.run import ExportSettings

    to = files.to
    with locked(source, writing=to.resolve() == source.resolve()):
        folder = read_map_folder(source)
        folder = replace(folder, georeference=earth.georeference(folder.georeference))
        exported = export_with_progress(
            folder, to, ExportSettings(tuple(files.format), earth.crs, files.cell, files.rate), quiet or as_json
        )
    if as_json:
        typer.echo(json.dumps([str(path) for path in exported.files]))
    else:
        typer.echo(f"written to {printable(str(to))}: {', '.join(path.name for path in exported.files)}")
