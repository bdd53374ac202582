"""`sonarmap config`: every setting, its unit and default, what is in force, and a file to set them."""

import json
from collections.abc import Sequence
from importlib import metadata
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.options.option import OUTPUT
from sonarmap.tools.command.options.running import JsonOption
from sonarmap.tools.command.terminal import printable, result_console, say

if TYPE_CHECKING:
    from sonarmap.tools.command.settings.file import SettingsFile
    from sonarmap.tools.command.settings.listing import Row


def command(
    context: typer.Context,
    verb: Annotated[
        str | None, typer.Argument(metavar="[VERB]", help="List the settings of this verb alone.", show_default=False)
    ] = None,
    toml: Annotated[
        bool,
        typer.Option(
            "--toml", help="Print a TOML file of all settings, with comments, ready to edit.", rich_help_panel=OUTPUT
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """List every setting of every verb: its unit, its default, what is in force, and where that comes from.

    A setting is an option of the command line without its dashes. A TOML file sets it, in a section per verb, as
    grid = 96 under \\[map], or under \\[common] where it means the same for several. The command line counts for more
    than the file, and the file for more than the default. `sonarmap --config FILE VERB ...` uses a file; without it
    sonarmap.toml in the current folder is used, and a line on stderr says so.
    """
    from sonarmap.tools.command.settings.in_force import settings_file
    from sonarmap.tools.command.settings.listing import as_json as in_json
    from sonarmap.tools.command.settings.listing import as_toml, rows_of
    from sonarmap.tools.command.settings.setting import settings_of

    if toml and as_json:
        raise InputError("--toml and --json are two forms of the same list; leave one out")
    verbs: Any = context.find_root().command
    if verb is not None and verb not in verbs.commands:
        raise InputError(f"{verb!r} is not a verb; choose one of {', '.join(verbs.commands)}")
    file = settings_file(context)
    rows = [row for row in rows_of(settings_of(verbs.commands), file) if verb is None or verb in row.verbs]
    if as_json:
        path = None if file is None else str(file.path)
        typer.echo(json.dumps({"file": path, "settings": in_json(rows)}, indent=2))
    elif toml:
        typer.echo("\n".join(as_toml(rows, metadata.version("sonarmap"))))
    else:
        _print_table(rows, file)


def _print_table(rows: "Sequence[Row]", file: "SettingsFile | None") -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False)
    table.add_column("setting", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("default", overflow="fold")
    if file is not None:
        table.add_column("in force", overflow="fold")
        table.add_column(Text(f"from {printable(file.path.name)}"))
    section = ""
    for row in rows:
        if row.section != section:
            section = row.section
            table.add_row(Text(f"[{section}]", "bold"))
        cells = [f"  {row.setting.key}", row.setting.unit, row.setting.default]
        cells += [row.in_force, f"[{row.place}]"] if row.value is not None else []
        table.add_row(*(Text(printable(cell)) for cell in cells))
    result_console().print(table)
    if file is None:
        say("all defaults are in force: no file is given by --config, and sonarmap.toml is not in this folder")
