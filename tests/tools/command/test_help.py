"""The help: verbs in groups, common options in --help, all options in --help-all."""

import pytest
import typer
from typer.testing import CliRunner

from sonarmap.tools.command.main import GROUPS, VERBS, app

# pyrefly: ignore[missing-attribute]
COMMANDS = typer.main.get_command(app).commands


def page(*arguments: str) -> str:
    result = CliRunner(env={"COLUMNS": "100"}).invoke(app, [*arguments])
    assert result.exit_code == 0
    return result.stdout


def test_verbs_are_listed_in_groups() -> None:
    words = page("--help").replace("│", " ").split()
    places = [words.index(verb, words.index(group.split()[0])) for group, verbs in GROUPS.items() for verb in verbs]
    assert places == sorted(places)
    assert set(COMMANDS) == set(VERBS)


@pytest.mark.parametrize("verb", VERBS)
def test_rare_options_are_counted_in_help_and_listed_in_help_all(verb: str) -> None:
    for parameter in COMMANDS[verb].params:
        assert parameter.help, parameter.name
    rare = [parameter for parameter in COMMANDS[verb].params if parameter.hidden]
    short, long = page(verb, "--help"), page(verb, "--help-all")
    assert (f"{len(rare)} more options: sonarmap {verb} --help-all" in short) == bool(rare)
    options = [parameter for parameter in COMMANDS[verb].params if parameter.param_type_name == "option"]
    # pyrefly: ignore[unsupported-operation]
    assert all(max(option.opts, key=len) in long for option in options)
