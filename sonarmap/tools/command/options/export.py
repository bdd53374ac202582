"""The options that say what a map is exported to; those of `export` and of `map --export`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sonarmap.tools.command.options.groups import OUTPUT
from sonarmap.tools.command.options.option import completes_list
from sonarmap.tools.command.progress import growing_progress
from sonarmap.tools.command.terminal import say
from sonarmap.tools.products.export.formats import FORMATS

if TYPE_CHECKING:
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


FormatsOption = Annotated[
    list[str],
    typer.Option(
        metavar="NAME",
        help=f"{', '.join(FORMATS)}; several separated by commas. {_KNOWN}. The option may also be repeated.",
        callback=_check_formats,
        rich_help_panel=OUTPUT,
        autocompletion=completes_list(FORMATS),
    ),
]


def export_with_progress(folder: "MapFolder", to: Path, settings: "ExportSettings", quiet: bool) -> "Exported":
    """Export a map, and say what the user should know about it.

    Raises InputError: see `tools.products.export.run.export_map`.
    """
    from sonarmap.tools.products.export.run import export_map

    with growing_progress("exporting", quiet) as step:
        exported = export_map(folder, to, settings, step)
    for note in exported.notes:
        say(note)
    return exported
