"""The options that verbs share: their defaults and what arrives of them; arguments in errors become options."""

from dataclasses import fields

import numpy as np
import pytest
import typer
from typer.testing import CliRunner, Result

from sonarmap.spectral.hemisphere.registration import HemisphereConfig
from sonarmap.spectral.registration import SpectralConfig
from sonarmap.tools.command.arguments import OPTIONS, as_options
from sonarmap.tools.command.main import VERBS, app
from sonarmap.tools.command.options.option import spread
from sonarmap.tools.command.options.registration import MethodOptions

USUAL = MethodOptions()


def arrived(arguments: str) -> Result:
    """What a verb of our own that takes every shared option prints of them."""
    probe, names = typer.Typer(), ("grid", "voxel", "max_tilt", "hypotheses", "yaw_peaks", "device", "seed")

    def command(method: MethodOptions) -> None:
        typer.echo(" ".join(str(getattr(method, name)) for name in names))

    probe.command()(spread(command))
    return CliRunner(env={"COLUMNS": "300", "TERMINAL_WIDTH": "300"}).invoke(probe, arguments.split())


class TestSharedOptions:
    @pytest.mark.parametrize(
        ("arguments", "printed"),
        [
            ("", "None None 35.0 6 1 None 0"),
            (
                "--grid 64 --voxel 0.5 --max-tilt 12.5 --hypotheses 64 --yaw-peaks 32 --device cpu --seed 7",
                "64 0.5 12.5 64 32 cpu 7",
            ),
        ],
    )
    def test_values(self, arguments: str, printed: str) -> None:
        assert arrived(arguments).stdout == f"{printed}\n"

    def test_the_defaults_are_those_of_the_configurations(self) -> None:
        usual = SpectralConfig()
        assert usual.hypotheses == USUAL.hypotheses
        assert usual.max_tilt == pytest.approx(np.deg2rad(USUAL.max_tilt))
        assert HemisphereConfig.paper().yaw_peaks == USUAL.yaw_peaks

    @pytest.mark.parametrize("edge", ["16", "90", "96", "512"])
    def test_the_ends_of_the_grids_range(self, edge: str) -> None:
        assert arrived(f"--grid {edge}").exit_code == 0


@pytest.mark.parametrize(
    ("message", "shown"),
    [
        ("`edge=98` is not; try `edge=96` or `edge=100`", "--grid 98 is not; try --grid 96 or --grid 100"),
        ("`scheduler=tcp://10.0.0.5:8786`", "--scheduler tcp://10.0.0.5:8786"),
        ("`use_strength=True` needs strengths", "--strength needs strengths"),
        ("`bandwidth=7` and `stack`", "bandwidth=7 and stack"),
        ("run `sonarmap map` first", "run `sonarmap map` first"),
    ],
)
def test_an_argument_becomes_its_option(message: str, shown: str) -> None:
    assert as_options(message) == shown


def test_every_option_of_the_table_is_one_of_a_verb() -> None:
    from typer.main import get_command

    commands = [get_command(app).commands[verb] for verb in VERBS]  # pyright: ignore[reportAttributeAccessIssue]
    options = {option for command in commands for parameter in command.params for option in parameter.opts}
    assert set(OPTIONS.values()) <= options


def test_every_setting_that_an_option_changes_is_in_the_table() -> None:
    settings = {field.name for config in (SpectralConfig, HemisphereConfig) for field in fields(config)}
    assert settings & OPTIONS.keys() == {"max_tilt", "hypotheses", "yaw_peaks", "use_strength"}
