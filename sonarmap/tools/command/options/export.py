"""The options that say what a map is exported to; those of `export` and of `map --export`."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.options.groups import OUTPUT, completes_list
from sonarmap.tools.command.progress import growing_progress
from sonarmap.tools.command.terminal import say
from sonarmap.tools.products.export.formats import FORMATS

if TYPE_CHECKING:
    from sonarmap.spectral.scan import Scan
    from sonarmap.tools.files.geo.georeference import Georeference
    from sonarmap.tools.files.map_folder.folder import MapFolder
    from sonarmap.tools.products.export.run import Exported, ExportSettings

_KNOWN = "; ".join(f"{name}: {known.words}" for name, known in FORMATS.items())


def _check_formats(values: list[str] | None) -> list[str] | None:
    """The names, each once, commas taken apart."""
    names = [name.strip().lower() for value in values or () for name in value.split(",")]
    for name in names:
        if name not in FORMATS:
            raise typer.BadParameter(f"{name!r}; choose from {', '.join(FORMATS)}, several separated by commas")
    return list(dict.fromkeys(names))


def _check_cell(cell: float | None) -> float | None:
    if cell is None or 0 < cell < float("inf"):
        return cell
    raise typer.BadParameter(f"{cell} m; give a length above 0, or leave it out for the map's voxel")


def _option(flag: str) -> typer.models.OptionInfo:
    return typer.Option(
        flag,
        metavar="NAME",
        help=f"{', '.join(FORMATS)}; several separated by commas. {_KNOWN}. The option may also be repeated.",
        callback=_check_formats,
        rich_help_panel=OUTPUT,
        autocompletion=completes_list(FORMATS),
    )


FormatOption = Annotated[list[str], _option("--format")]
ExportOption = Annotated[list[str], _option("--export")]
CellOption = Annotated[
    float | None,
    typer.Option(
        "--cell",
        metavar="M",
        callback=_check_cell,
        help="Edge of a grid's cell \\[m].",
        rich_help_panel=OUTPUT,
        show_default="the map's voxel",
    ),
]


def export_settings(
    formats: list[str],
    crs: str | None,
    also: list[str],
    georeference: "Georeference | None",
    scans: "Sequence[Scan]",
    out: Path,
) -> "ExportSettings":
    """What --export and --crs ask for, refused now where it could not be done when the map is there, in `out`."""
    from sonarmap.tools.files.map_folder.names import EXPORTS, OF_EACH
    from sonarmap.tools.products.export.run import ExportSettings, check_files, check_settings

    if crs is not None and not formats:
        raise InputError("--crs has no effect without --export; leave it out, or name a format")
    settings = ExportSettings(tuple(formats), crs)
    check_settings(settings, georeference, [scan.stamp for scan in scans] if formats else [])
    if both := [name for name in also if EXPORTS[name] in {FORMATS[chosen].file for chosen in formats}]:
        raise InputError(f"--also and --export would both write {EXPORTS[both[0]].format('')}; leave one out")
    if own := [name for name in formats if FORMATS[name].file in OF_EACH]:
        file = FORMATS[own[0]].file.format("")
        raise InputError(f"--export {own[0]} would write {file}, which `map` writes anyway; leave it out")
    check_files(settings, out)
    return settings


def export_with_progress(folder: "MapFolder", to: Path, settings: "ExportSettings", quiet: bool) -> "Exported":
    """Export a map, and say what the user should know about it.

    Raises:
        InputError: see `tools.products.export.run.export_map`.
    """
    from sonarmap.tools.products.export.run import export_map

    with growing_progress("exporting", quiet) as step:
        exported = export_map(folder, to, settings, step)
    for note in exported.notes:
        say(note)
    return exported
