"""The evaluation's experiments on a pair or two: which pairs they take, and that their rows are decided by these."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from sonarmap.kernels.device.device import Device
from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.reproduce import methods
from sonarmap.tools.lab.reproduce.evaluation.pair_set import Pairs, related, unrelated
from sonarmap.tools.lab.reproduce.evaluation.settings import PairsSettings
from sonarmap.tools.lab.reproduce.experiment import Experiment, Row
from sonarmap.tools.lab.reproduce.experiments import EXPERIMENTS, Request, create
from sonarmap.tools.lab.reproduce.folder import section_text
from sonarmap.tools.lab.reproduce.methods import EVALUATED
from sonarmap.tools.lab.reproduce.provenance import provenance
from sonarmap.tools.lab.reproduce.run import RunOptions, run
from sonarmap.tools.lab.reproduce.worker import WorkerProcesses
from tests.samples.experiments.shown import run_all, show
from tests.tools.lab.reproduce.test_run import silence

FEW = ("hemisphere", "planes")
NAMES = ("steps", "pairs", "unrelated")


def request(device: Device, **changes: object) -> Request:
    return Request(device, True, **{"grid": 32, "method": FEW, **changes})  # pyright: ignore[reportArgumentType]


class TestPairs:
    def test_the_bound_on_tilt_is_lifted_where_there_is_one(self, device: Device) -> None:
        bounded, free = (
            methods.registrar("hemisphere", Grid(16, 1.0), device.selector, bound) for bound in (None, math.pi)
        )
        assert (bounded.config.max_tilt, free.config.max_tilt) == (math.radians(35), math.pi)  # pyright: ignore
        methods.registrar("planes", Grid(16, 1.0), None, math.pi)

    @pytest.mark.slow
    def test_the_overlap_is_that_without_noise_and_strangers_share_nothing(self) -> None:
        for number, low in ((0, 0.05), (2, 0.4), (4, 0.8)):
            pair = related(number, 3, "yaw", 32)
            assert pair is not None
            assert low - 1e-4 <= float(pair.cells["shared"]) <= low + 0.2001
        stranger = unrelated(1, 3, 32)
        assert stranger is not None
        assert (stranger.truth, stranger.cells["shared"], stranger.grid.edge) == (None, 0.0, 32)

    def test_the_truth_lays_the_shared_points_on_each_other(self) -> None:
        pair = related(4, 3, "any", 32)
        assert pair is not None
        assert pair.truth is not None
        tree = KDTree(pair.target.points)
        assert np.median(tree.query(pair.truth.apply(pair.source.points))[0]) < pair.grid.voxel
        assert tree.query(pair.source.points)[0].mean() > 3 * pair.grid.voxel

    def test_jobs_do_not_depend_on_how_many_pairs_are_asked_for(self) -> None:
        few, many = (Pairs(PairsSettings(yaw=n, any=n), None) for n in (6, 20))
        assert set(few.jobs()) < set(many.jobs())
        assert len(few.jobs()) == 2 * 2 * len(EVALUATED)


def tiny(name: str, device: Device) -> Experiment:
    methods = FEW[1:] if name == "unrelated" else FEW
    return create(name, request(device, method=methods, pairs=None if name == "steps" else 1))


@cache
def done(name: str, device: Device) -> tuple[list[Row], list[Row]]:
    """Rows and times of a tiny run."""
    return run_all(tiny(name, device))


class TestRuns:
    @pytest.mark.parametrize("name", NAMES)
    @pytest.mark.slow
    def test_a_section_its_pictures_and_no_times_in_rows(self, name: str, device: Device, tmp_path: Path) -> None:
        experiment, (rows, seconds) = tiny(name, device), done(name, device)
        assert rows
        text = section_text(show(experiment, tmp_path, rows, seconds))
        assert all(f"\n| {method} |" in text for method in experiment.settings.compared.methods)

    @pytest.mark.slow
    def test_a_stranger_has_no_verdict(self, device: Device) -> None:
        assert all("right" not in row and "nees" not in row for row in done("unrelated", device)[0])

    @pytest.mark.slow
    def test_a_small_step_is_found(self, device: Device) -> None:
        rows = done("steps", device)[0]
        assert [row["step"] for row in rows] == [*range(13), *range(13)]
        assert any(row["right"] for row in rows if row["step"] in (0, 1))

    @pytest.mark.slow
    def test_rows_are_the_same_whatever_the_number_of_workers(self, device: Device, tmp_path: Path) -> None:
        asked = request(device, pairs=10)
        module, experiment = EXPERIMENTS["unrelated"].module, create("unrelated", asked)
        two = WorkerProcesses(2, module, replace(asked, device=None), device.selector)
        origin, options = provenance(experiment, device), {"alone": RunOptions(), "shared": RunOptions(workers=two)}
        runs = [run(experiment, origin, tmp_path / name, silence, how).outcomes for name, how in options.items()]
        assert list(runs[0]) == list(runs[1]) == ["000/hemisphere", "000/planes", "001/hemisphere", "001/planes"]
        assert str(runs[0]) == str(runs[1])

    def test_rows_of_a_method_are_used_whatever_other_pairs_and_methods_are_asked_for(self, device: Device) -> None:
        few = provenance(create("pairs", request(device, pairs=5)), device)
        more = provenance(create("pairs", request(device, method=FEW[1:], pairs=10)), device)
        assert few.key("yaw/000/planes") == more.key("yaw/000/planes")
        assert few.methods["planes"] == more.methods["planes"]
        assert set(few.methods) == set(FEW)
