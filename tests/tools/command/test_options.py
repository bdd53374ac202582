"""The options that verbs share: their defaults, and what they refuse."""

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from sonarmap.spectral.hemisphere.registration import HemisphereConfig
from sonarmap.spectral.registration import SpectralConfig
from sonarmap.tools.command.options.registration import (
    DEFAULT_HYPOTHESES,
    DEFAULT_MAX_TILT,
    DEFAULT_REFINEMENT,
    DEFAULT_YAW_PEAKS,
    DeviceOption,
    GridOption,
    HypothesesOption,
    MaxTiltOption,
    RefineOption,
    SeedOption,
    VoxelOption,
    YawPeaksOption,
)


class TestSharedOptions:
    """A verb of our own that takes every shared option and prints what arrives."""

    @pytest.fixture
    def verb(self) -> typer.Typer:
        probe = typer.Typer()

        @probe.command()
        def command(
            grid: GridOption = None,
            voxel: VoxelOption = None,
            max_tilt: MaxTiltOption = 35.0,
            hypotheses: HypothesesOption = 12,
            refine: RefineOption = "icp",
            yaw_peaks: YawPeaksOption = 1,
            device: DeviceOption = None,
            seed: SeedOption = 0,
        ) -> None:
            typer.echo(f"{grid} {voxel} {max_tilt} {hypotheses} {refine} {yaw_peaks} {device} {seed}")

        return probe

    def test_defaults(self, verb: typer.Typer) -> None:
        assert CliRunner().invoke(verb, []).stdout == "None None 35.0 12 icp 1 None 0\n"

    def test_values(self, verb: typer.Typer) -> None:
        arguments = [
            "--grid",
            "64",
            "--voxel",
            "0.5",
            "--max-tilt",
            "12.5",
            "--hypotheses",
            "64",
            "--refine",
            "spectral",
            "--yaw-peaks",
            "32",
            "--device",
            "cpu",
            "--seed",
            "7",
        ]
        assert CliRunner().invoke(verb, arguments).stdout == "64 0.5 12.5 64 spectral 32 cpu 7\n"

    def test_the_defaults_are_those_of_the_configurations(self) -> None:
        usual = SpectralConfig()
        assert (usual.hypotheses, usual.refinement) == (DEFAULT_HYPOTHESES, DEFAULT_REFINEMENT)
        assert usual.max_tilt == pytest.approx(np.deg2rad(DEFAULT_MAX_TILT))
        assert HemisphereConfig.paper().yaw_peaks == DEFAULT_YAW_PEAKS

    @pytest.mark.parametrize("edge", ["16", "90", "96", "512"])
    def test_the_ends_of_the_grids_range(self, verb: typer.Typer, edge: str) -> None:
        assert CliRunner().invoke(verb, ["--grid", edge]).exit_code == 0

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
    def test_refusals(self, verb: typer.Typer, arguments: str, words: list[str]) -> None:
        """Each says what was given, what was wanted and what to do."""
        result = CliRunner(env={"COLUMNS": "300", "TERMINAL_WIDTH": "300"}).invoke(verb, arguments.split())
        assert result.exit_code == 2
        message = " ".join(result.stderr.split())
        assert all(word in message for word in words), message
