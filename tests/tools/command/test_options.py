"""The options that verbs share: their defaults and what arrives of them; arguments in errors become options."""

import re

import pytest
import typer
from typer.testing import CliRunner, Result

from sonarmap.slam.mapper import MapperSettings
from sonarmap.tools.command.failures import OPTIONS, as_options
from sonarmap.tools.command.main import VERBS, app
from sonarmap.tools.command.method import MethodOptions, changed
from sonarmap.tools.command.option import spread
from tests.samples.refusals import refuses


def arrived(arguments: str) -> Result:
    """What a verb of our own that takes every shared option prints of them."""
    probe, names = typer.Typer(), ("grid", "voxel", "max_tilt", "settings", "device", "seed")

    def command(method: MethodOptions) -> None:
        typer.echo(" ".join(str(getattr(method, name)) for name in names))

    probe.command()(spread(command))
    return CliRunner(env={"COLUMNS": "300", "TERMINAL_WIDTH": "300"}).invoke(probe, arguments.split())


class TestSharedOptions:
    @pytest.mark.parametrize(
        ("arguments", "printed"),
        [
            ("", "None None None [] None None"),
            (
                "--grid 64 --voxel 0.5 --max-tilt 12.5 --set hypotheses=64 --set keys.step=2 --device cpu --seed 7",
                "64 0.5 12.5 ['hypotheses=64', 'keys.step=2'] cpu 7",
            ),
        ],
    )
    def test_values(self, arguments: str, printed: str) -> None:
        assert arrived(arguments).stdout == f"{printed}\n"

    @pytest.mark.parametrize("edge", ["16", "90", "96", "512"])
    def test_the_ends_of_the_grids_range(self, edge: str) -> None:
        assert arrived(f"--grid {edge}").exit_code == 0


@pytest.mark.parametrize(
    ("message", "shown"),
    [
        ("`edge=98` is not; try `edge=96` or `edge=100`", "--grid 98 is not; try --grid 96 or --grid 100"),
        ("`bandwidth=7` and `stack`", "bandwidth=7 and stack"),
        ("run `sonarmap map` first", "run `sonarmap map` first"),
    ],
)
def test_an_argument_becomes_its_option(message: str, shown: str) -> None:
    assert as_options(message) == shown


def test_every_option_of_the_table_is_one_of_a_verb() -> None:
    from typer.main import get_command

    # pyrefly: ignore[missing-attribute]
    commands = [get_command(app).commands[verb] for verb in VERBS]
    options = {option for command in commands for parameter in command.params for option in parameter.opts}
    assert set(OPTIONS.values()) <= options


def test_set_reaches_every_field() -> None:
    settings = changed(MapperSettings(), ["limits.step=2", "keys.step=0.5", "min_seen=3", "straighten=false"])
    assert (settings.limits.step, settings.keys.step, settings.min_seen, settings.straighten) == (2, 0.5, 3, False)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("minseen=3", "there is no 'minseen'; choose from loops, limits"),
        ("min_seen=2.5", "wanted a whole number, as in --set min_seen=2"),
        ("straighten=1", "wanted true or false"),
        ("limits.step=fast", "wanted a number"),
        ("limits=2", "there is no ''; choose from speed"),
        ("min_seen.x=2", "wanted a whole number"),
        ("min_seen=0", "`min_seen=0`"),
    ],
)
def test_a_mistake_in_set(text: str, words: str) -> None:
    refuses(re.escape(words), changed, MapperSettings(), [text])
