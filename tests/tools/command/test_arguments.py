"""Arguments in the library's errors become the options that set them."""

from dataclasses import fields

import pytest

from sonarmap.kernels.errors import DeviceError, InputError, SonarmapError
from sonarmap.spectral.hemisphere.registration import HemisphereConfig
from sonarmap.spectral.registration import SpectralConfig
from sonarmap.tools.command.arguments import OPTIONS, as_options
from sonarmap.tools.command.main import VERBS, app
from tests.tools.command.test_cli import exit_code_of, raiser


@pytest.mark.parametrize(
    ("message", "shown"),
    [
        ("`edge=98` is not; try `edge=96` or `edge=100`", "--grid 98 is not; try --grid 96 or --grid 100"),
        ("give a larger `voxel`", "give a larger --voxel"),
        ("`scheduler=tcp://10.0.0.5:8786`", "--scheduler tcp://10.0.0.5:8786"),
        ("`use_strength=True` needs strengths", "--strength needs strengths"),
        ("`bandwidth=7` and `stack`", "bandwidth=7 and stack"),
        ("run `sonarmap map` first", "run `sonarmap map` first"),
        ("edge=100, max_tilt", "edge=100, max_tilt"),
    ],
)
def test_an_argument_becomes_its_option(message: str, shown: str) -> None:
    assert as_options(message) == shown


@pytest.mark.parametrize("kind", [InputError, DeviceError])
def test_errors_are_printed_with_options(kind: type[SonarmapError], capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code_of(raiser(kind("too large; use `edge=64`"))) == 2
    assert capsys.readouterr().err == "error: too large; use --grid 64\n"


def test_every_option_of_the_table_is_one_of_a_verb() -> None:
    from typer.main import get_command

    commands = [get_command(app).commands[verb] for verb in VERBS]  # pyright: ignore[reportAttributeAccessIssue]
    options = {option for command in commands for parameter in command.params for option in parameter.opts}
    assert set(OPTIONS.values()) <= options


def test_every_setting_that_an_option_changes_is_in_the_table() -> None:
    settings = {field.name for config in (SpectralConfig, HemisphereConfig) for field in fields(config)}
    assert settings & OPTIONS.keys() == {"max_tilt", "hypotheses", "refinement", "yaw_peaks", "use_strength"}
