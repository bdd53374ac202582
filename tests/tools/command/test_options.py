"""The options that verbs share: their defaults, and what they refuse."""

import numpy as np
import pytest
import typer
from typer.testing import CliRunner, Result

from sonarmap.spectral.hemisphere.registration import HemisphereConfig
from sonarmap.spectral.registration import SpectralConfig
from sonarmap.tools.command.options.option import spread
from sonarmap.tools.command.options.registration import MethodOptions

USUAL = MethodOptions()


def arrived(arguments: str) -> Result:
    """What a verb of our own that takes every shared option prints of them."""
    probe, names = typer.Typer(), ("grid", "voxel", "max_tilt", "hypotheses", "refine", "yaw_peaks", "device", "seed")

    def command(method: MethodOptions) -> None:
        typer.echo(" ".join(str(getattr(method, name)) for name in names))

    probe.command()(spread(command, {}))
    return CliRunner(env={"COLUMNS": "300", "TERMINAL_WIDTH": "300"}).invoke(probe, arguments.split())


class TestSharedOptions:
    @pytest.mark.parametrize(
        ("arguments", "printed"),
        [
            ("", "None None 35.0 6 icp 1 None 0"),
            (
                "--grid 64 --voxel 0.5 --max-tilt 12.5 --hypotheses 64 --refine spectral --yaw-peaks 32 --device cpu "
                "--seed 7",
                "64 0.5 12.5 64 spectral 32 cpu 7",
            ),
        ],
    )
    def test_values(self, arguments: str, printed: str) -> None:
        assert arrived(arguments).stdout == f"{printed}\n"

    def test_the_defaults_are_those_of_the_configurations(self) -> None:
        usual = SpectralConfig()
        assert (usual.hypotheses, usual.refinement) == (USUAL.hypotheses, USUAL.refine)
        assert usual.max_tilt == pytest.approx(np.deg2rad(USUAL.max_tilt))
        assert HemisphereConfig.paper().yaw_peaks == USUAL.yaw_peaks

    @pytest.mark.parametrize("edge", ["16", "90", "96", "512"])
    def test_the_ends_of_the_grids_range(self, edge: str) -> None:
        assert arrived(f"--grid {edge}").exit_code == 0

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [
            (
                "--grid 98",
                ["--grid 98 is not an even product of 2, 3 and 5 from 16 to 512", "try --grid 96 or --grid 100"],
            ),
            ("--grid 8", ["--grid 8 is not", "try --grid 16"]),
            ("--grid 1024", ["--grid 1024 is not", "--grid 512"]),
            ("--grid -4", ["--grid -4 is not", "try --grid 16"]),
            ("--grid many", ["--grid", "integer"]),
            ("--voxel 0", ["0.0 m", "above 0", "--voxel 0.5"]),
            ("--voxel nan", ["nan m", "above 0"]),
            ("--voxel inf", ["inf m", "above 0"]),
            ("--max-tilt -5", ["-5.0 degrees", "more than 0 and at most 180"]),
            ("--max-tilt nan", ["nan degrees"]),
            ("--max-tilt 181", ["181.0 degrees"]),
            ("--hypotheses 0", ["0 rotations", "give 1 to 64", "--hypotheses 6"]),
            ("--hypotheses 65", ["65 rotations"]),
            ("--refine ICP", ["'ICP'", "icp or spectral"]),
            ("--yaw-peaks 0", ["0 peaks", "give 1 to 32", "--yaw-peaks 6"]),
            ("--seed -1", ["-1", "whole number", "as in --seed 1"]),
        ],
    )
    def test_refusals(self, arguments: str, words: list[str]) -> None:
        """Each says what was given, what was wanted and what to do."""
        result = arrived(arguments)
        assert result.exit_code == 2
        message = " ".join(result.stderr.split())
        assert all(word in message for word in words), message
