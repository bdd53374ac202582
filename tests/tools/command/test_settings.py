"""Options that a TOML file sets."""

import re
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from sonarmap.tools.command.main import app, read_settings
from tests.samples.refusals import refuses

VERBS: Any = typer.main.get_command(app)


def write(folder: Path, text: str) -> Path:
    path = folder / "survey.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_every_option_can_be_set_in_the_file(tmp_path: Path) -> None:
    """Keys are names on the command line, with dashes or underscores; values are the options' defaults."""
    lines, wanted = list[str](), dict[str, dict[str, Any]]()
    for verb, command in VERBS.commands.items():
        lines.append(f"[{verb}]")
        wanted[verb] = {}
        for option in command.params:
            if option.param_type_name == "option" and type(option.default) in (bool, int, float, str):
                # pyrefly: ignore[missing-attribute]
                key = max(option.opts, key=len).lstrip("-").replace("-", "_" if len(lines) % 2 else "-")
                value = option.default
                lines.append(f"{key} = {str(value).lower() if isinstance(value, bool) else repr(value)}")
                wanted[verb][option.name] = value
    assert sum(map(len, wanted.values())) > 50
    assert read_settings(write(tmp_path, "\n".join(lines)), VERBS.commands) == wanted


def test_the_command_line_overrides_the_file_and_used_settings_are_printed(tmp_path: Path) -> None:
    path = write(tmp_path, "[bench]\ngrid = 16\npairs = 3\n[map]\ngrid = 64\n")
    arguments = ["--config", str(path), "bench", "--no-kernels", "--pairs", "0"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    assert f"settings from {path}: grid [16]\n" in result.stderr
    assert "leave nothing to measure" in result.stderr


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[map]\ngird = 3", "gird is not an option of map; perhaps grid"),
        ("[mop]\ngrid = 3", "[mop] is not a verb; perhaps map"),
        ("grid = 96", "grid stands outside of a section; put it under a verb's"),
        ("[map]\ngrid = ", "no TOML file"),
    ],
)
def test_a_mistake_is_refused_with_its_place_and_a_suggestion(tmp_path: Path, text: str, words: str) -> None:
    path = write(tmp_path, text)
    refuses(re.escape(words), read_settings, path, VERBS.commands)
    refuses(re.escape(str(path)), read_settings, path, VERBS.commands)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("grid = 'a'", "Invalid value for '--grid'"),
        ("max-speed = [1, 2]", "Invalid value for '--max-speed'"),
        ("export = ['laz', 'nix']", "'nix'; choose from"),
    ],
)
def test_only_values_of_the_verb_that_runs_are_checked(tmp_path: Path, line: str, words: str) -> None:
    path = write(tmp_path, f"[map]\n{line}\n")
    result = CliRunner().invoke(app, ["--config", str(path), "map", "a.ply", "-o", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert words in result.stderr
    assert CliRunner().invoke(app, ["--config", str(path), "bench", "--help"]).exit_code == 0
