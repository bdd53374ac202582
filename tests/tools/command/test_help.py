"""The help: what is common fits a screen, and nothing is missing in the long one."""

import re

import pytest
import typer
from typer.testing import CliRunner

from sonarmap.tools.command.main import VERBS, app
from sonarmap.tools.command.options.option import GROUPS

COMMANDS = typer.main.get_command(app).commands  # pyright: ignore[reportAttributeAccessIssue]
MOST_ROWS = {"map": 45, "live": 55, "register": 40, "locate": 40, "compare": 36, "simulate": 40}


def page(*arguments: str, columns: int = 80) -> list[str]:
    result = CliRunner(env={"COLUMNS": str(columns)}).invoke(app, [*arguments])
    assert result.exit_code == 0
    return result.stdout.splitlines()


def flowing(lines: list[str]) -> str:
    return " ".join(" ".join(lines).split())


@pytest.mark.parametrize("verb", VERBS)
def test_the_short_help_fits_a_screen(verb: str) -> None:
    lines = page(verb, "--help")
    assert len(lines) <= MOST_ROWS.get(verb, 33)
    assert max(map(len, lines)) <= 80
    assert lines[0].startswith(f"Usage: sonarmap {verb}")
    assert f"sonarmap {verb} --help-all" in lines[-2 if not lines[-1] else -1]


@pytest.mark.parametrize("columns", [80])
@pytest.mark.parametrize("verb", VERBS)
def test_the_long_help_has_every_option_with_all_its_words(verb: str, columns: int) -> None:
    lines = page(verb, "--help-all", columns=columns)
    assert max(map(len, lines)) <= columns
    text = flowing(lines)
    for parameter in COMMANDS[verb].params:
        if parameter.name == "help_all":
            continue
        for name in (*parameter.opts, *parameter.secondary_opts):
            assert name in text or parameter.param_type_name == "argument"
        plain = re.sub(r"\\\[", "[", parameter.help or "")
        assert plain.split()[-1] in text if columns > 40 else plain.split()[-1][:12] in text


@pytest.mark.parametrize("verb", VERBS)
def test_every_option_is_in_a_group_and_has_words(verb: str) -> None:
    for parameter in COMMANDS[verb].params:
        assert parameter.help, parameter.name
        if parameter.param_type_name == "option" and parameter.name != "help_all":
            assert parameter.rich_help_panel in GROUPS, f"give {parameter.name} of {verb} a rich_help_panel of GROUPS"


def test_rare_options_are_counted_and_left_to_the_long_help() -> None:
    short, long = flowing(page("map", "--help")), flowing(page("map", "--help-all"))
    assert "--hypotheses" not in short
    assert "--hypotheses K" in long
    hidden = [each for each in COMMANDS["map"].params if each.hidden and each.name != "help_all"]
    assert f"{len(hidden)} more options, and the details: sonarmap map --help-all" in short


def test_the_help_of_the_command_fits_a_screen() -> None:
    lines = page("--help")
    assert len(lines) <= 40
    assert all(any(line.startswith(f"  {verb} ") for line in lines) for verb in VERBS)
    assert any(line.startswith("  view       Open a finished map's report, OUT/report.html") for line in lines)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("verb", "words"),
    [
        ("map", "--grid N Voxels per edge, 16..512. The number is an even product of 2, 3 and 5. [default: 128]"),
        ("map", "[default: 35]"),
        ("map", "--report/--no-report Write report.html, the page that `sonarmap view OUT` opens. [default: --report]"),
        ("map", "[default: learned]"),
        ("register", "[default: --no-strength]"),
        ("evaluate", "[default: poses]"),
        ("bench", "[default: 64, 128 and 256]"),
        ("record", "[default: until Ctrl-C]"),
        ("reproduce", "[default: reproduction]"),
        ("simulate", "[default: floodgate]"),
    ],
)
def test_defaults_are_seen(verb: str, words: str) -> None:
    assert words in flowing(page(verb, "--help-all"))


def test_the_call_is_shown_with_what_it_needs() -> None:
    assert page("map", "--help")[0] == "Usage: sonarmap map INPUT... -o OUT [OPTIONS]"
    assert page("reproduce", "--help")[0] == "Usage: sonarmap reproduce NAME [DIR] [OPTIONS]"
