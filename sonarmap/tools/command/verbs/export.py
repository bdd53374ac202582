"""`sonarmap export`: a finished map to the formats of other programs."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from sonarmap.tools.command.options.export import CellOption, FormatOption, export_with_progress
from sonarmap.tools.command.options.geo import (
    CrsOption,
    OriginHeadingOption,
    OriginOption,
    VerticalOption,
    georeference_of,
)
from sonarmap.tools.command.options.groups import OUTPUT
from sonarmap.tools.command.options.registration import JsonOption, QuietOption
from sonarmap.tools.command.terminal import printable
from sonarmap.tools.files.writers.folder_lock import locked


def command(
    source: Annotated[Path, typer.Argument(help="The folder that `sonarmap map` wrote.", metavar="OUT")],
    to: Annotated[
        Path,
        typer.Option("--to", help="Folder for the files; it may be OUT itself.", metavar="DIR", rich_help_panel=OUTPUT),
    ],
    formats: FormatOption,
    origin: OriginOption = None,
    origin_heading: OriginHeadingOption = None,
    vertical: VerticalOption = None,
    crs: CrsOption = None,
    cell: CellOption = None,
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

    with locked(source, writing=to.resolve() == source.resolve()):
        folder = read_map_folder(source)
        folder = replace(folder, georeference=georeference_of(origin, origin_heading, vertical, folder.georeference))
        exported = export_with_progress(folder, to, ExportSettings(tuple(formats), crs, cell), quiet or as_json)
    if as_json:
        typer.echo(json.dumps([str(path) for path in exported.files]))
    else:
        typer.echo(f"written to {printable(str(to))}: {', '.join(path.name for path in exported.files)}")
