"""`sonarmap config`: every setting, its unit and default, what is in force, and a file to set them."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import metadata
from textwrap import wrap
from typing import Annotated, Any

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.options.option import OUTPUT, switch
from sonarmap.tools.command.options.running import JsonOption
from sonarmap.tools.command.settings.file import SettingsFile
from sonarmap.tools.command.settings.in_force import settings_file
from sonarmap.tools.command.settings.setting import COMMON, Setting, common_settings, in_words, settings_of
from sonarmap.tools.command.terminal import print_json, printable, result_console, say

_PROSE = 100  # characters of a line of comment


def command(
    context: typer.Context,
    verb: Annotated[
        str | None, typer.Argument(metavar="[VERB]", help="List the settings of this verb alone.", show_default=False)
    ] = None,
    toml: Annotated[
        bool, switch(OUTPUT, "--toml", "Print a TOML file of all settings, with comments, ready to edit.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """List every setting of every verb: its unit, its default, what is in force, and where that comes from.

    A setting is an option of the command line without its dashes. A TOML file sets it, in a section per verb, as
    grid = 96 under \\[map], or under \\[common] where it means the same for several. The command line counts for more
    than the file, and the file for more than the default. `sonarmap --config FILE VERB ...` uses a file; without it
    sonarmap.toml in the current folder is used, and a line on stderr says so.
    """
    if toml and as_json:
        raise InputError("--toml and --json are two forms of the same list; leave one out")
    verbs: Any = context.find_root().command
    if verb is not None and verb not in verbs.commands:
        raise InputError(f"{verb!r} is not a verb; choose one of {', '.join(verbs.commands)}")
    file = settings_file(context)
    rows = [row for row in _rows_of(settings_of(verbs.commands), file) if verb is None or verb in row.verbs]
    if as_json:
        path = None if file is None else str(file.path)
        print_json({"file": path, "settings": _as_json(rows)}, indent=2)
    elif toml:
        typer.echo("\n".join(_as_toml(rows, metadata.version("sonarmap"))))
    else:
        _print_table(rows, file)


@dataclass(frozen=True, slots=True)
class Row:
    """A line of the list."""

    section: str  # where a file sets it
    setting: Setting  # of a verb, the first of those for which it means the same
    verbs: tuple[str, ...]  # all of these
    value: Any  # in force, as the file has it; None where the default counts
    place: str  # the file's section where it stands, or ""

    @property
    def in_force(self) -> str:
        """The value in words."""
        return self.setting.default if self.value is None else in_words(self.value)


def _rows_of(settings: Sequence[Setting], file: SettingsFile | None) -> list[Row]:
    """What means the same for several verbs first, then each verb's own.

    A verb whose own section sets what is common has a line of its own for it.
    """
    common = common_settings(list(settings))
    rows: list[Row] = []
    for group in common.values():
        verbs = tuple(setting.verb for setting in group)
        shared = next((setting for setting in group if _section(file, setting) == COMMON), group[0])
        at_home = _section(file, shared) == COMMON
        rows.append(_row(COMMON, shared, verbs, file if at_home else None))
    for setting in settings:
        shared = common.get(setting.key, [])
        if setting not in shared or _section(file, setting) == setting.verb:
            rows.append(_row(setting.verb, setting, (setting.verb,), file))
    return rows


def _as_json(rows: Sequence[Row]) -> list[dict[str, Any]]:
    return [
        {
            "section": row.section,
            "key": row.setting.key,
            "verbs": list(row.verbs),
            "type": row.setting.type,
            "many": row.setting.many,
            "unit": row.setting.unit or None,
            "default": row.setting.default,
            "value": row.value,
            "source": row.place or "default",
            "help": row.setting.about,
        }
        for row in rows
    ]


def _as_toml(rows: Sequence[Row], version: str) -> Iterator[str]:
    """The lines of a file that sets what is in force, and has all else behind a #."""
    yield f"# Settings of sonarmap {version}. Remove the # before a line and give its value to set it."
    yield "# Use the file by `sonarmap --config FILE VERB ...`, or call it sonarmap.toml in the folder where you work."
    section = ""
    for row in rows:
        if row.section != section:
            section = row.section
            yield from ("", f"[{section}]")
        yield ""
        verbs = f" ({', '.join(row.verbs)})" if section == COMMON else ""
        yield from (f"# {line}" for line in wrap(f"{row.setting.about}{verbs}", _PROSE, break_on_hyphens=False))
        wanted = row.setting.wanted
        yield f"# {wanted[0].upper()}{wanted[1:]}; default: {row.setting.default}"
        if row.value is None:
            yield f"# {row.setting.key} = {_example(row.setting)}"
        else:
            yield f"{row.setting.key} = {_literal(row.value)}"


def _section(file: SettingsFile | None, setting: Setting) -> str:
    """Where a file sets it; "" if it does not."""
    return "" if file is None else file.sections[setting.verb].get(setting.name, "")


def _row(section: str, setting: Setting, verbs: tuple[str, ...], file: SettingsFile | None) -> Row:
    place = _section(file, setting)
    return Row(section, setting, verbs, file.values[setting.verb][setting.name] if file and place else None, place)


def _example(setting: Setting) -> str:
    """The default as TOML has it, or what a value looks like."""
    value = setting.parameter.default
    if value is not None and value not in ([], ()) and not setting.parameter.required:
        return _literal(value)
    if setting.kind is int and setting.default.isdecimal():
        return setting.default
    metavar = setting.parameter.metavar or setting.key.upper()
    example = metavar if setting.kind in (int, float) else f'"{metavar}"'
    return f"[{example}]" if setting.many else example


def _literal(value: Any) -> str:
    """A value as TOML has it."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_literal, value))}]"
    return json.dumps(value if isinstance(value, bool | int | float) else str(value), ensure_ascii=False)


def _print_table(rows: Sequence[Row], file: SettingsFile | None) -> None:
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
