"""A table pins the names, values and defaults of all options of all verbs."""

from pathlib import Path
from typing import Any

import typer

from sonarmap.tools.command.main import app

TABLE = Path(__file__).with_name("option_table.txt")
# pyrefly: ignore[missing-attribute]
COMMANDS = typer.main.get_command(app).commands


def test_options_match_the_table() -> None:
    """The table has a line per option: verb, names, value or flag, default, and "rare" if only --help-all lists it."""
    rows = [row_of(verb, parameter) for verb, command in COMMANDS.items() for parameter in command.params]
    assert sorted(rows) == TABLE.read_text(encoding="utf-8").splitlines()


def row_of(verb: str, parameter: Any) -> str:
    names = " ".join(sorted([*parameter.opts, *parameter.secondary_opts]))
    takes = "flag" if getattr(parameter, "is_flag", False) else parameter.metavar
    many = " (several)" if getattr(parameter, "multiple", False) or parameter.nargs == -1 else ""
    default = "required" if parameter.required else f"default {parameter.default}"
    return f"{verb}: {names}: {takes}{many}, {default}{', rare' if parameter.hidden else ''}"
