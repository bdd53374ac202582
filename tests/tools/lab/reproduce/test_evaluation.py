"""The evaluation's experiments on a pair or two: which pairs they take, and that their rows are decided by these."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from sonarmap.kernels.device.device import Device
from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.reproduce import methods
from sonarmap.tools.lab.reproduce.evaluation.pair_set import Pairs, related
from sonarmap.tools.lab.reproduce.evaluation.settings import PairsSettings
from sonarmap.tools.lab.reproduce.experiments import Request, create
from sonarmap.tools.lab.reproduce.folder import section_text
from sonarmap.tools.lab.reproduce.methods import EVALUATED
from tests.samples.experiments.shown import run_all, show

FEW = ("hemisphere", "planes")


class TestPairs:
    def test_the_bound_on_tilt_is_lifted_where_there_is_one(self, device: Device) -> None:
        bounded, free = (
            methods.registrar("hemisphere", Grid(16, 1.0), device.selector, bound) for bound in (None, math.pi)
        )
        assert (bounded.config.max_tilt, free.config.max_tilt) == (math.radians(35), math.pi)  # pyright: ignore
        methods.registrar("planes", Grid(16, 1.0), None, math.pi)

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


@pytest.mark.parametrize("name", ["steps", "pairs", "unrelated"])
@pytest.mark.slow
def test_a_run_its_section_and_its_pictures(name: str, device: Device, tmp_path: Path) -> None:
    chosen = FEW[1:] if name == "unrelated" else FEW
    asked = {"grid": 32, "method": chosen, "pairs": None if name == "steps" else 1}
    experiment = create(name, Request(device, True, **asked))  # pyright: ignore[reportArgumentType]
    rows, seconds = run_all(experiment)
    text = section_text(show(experiment, tmp_path, rows, seconds))
    assert all(f"\n| {method} |" in text for method in chosen)
    if name == "unrelated":  # of a stranger nothing is right
        assert all("right" not in row and "nees" not in row for row in rows)
    if name == "steps":
        assert [row["step"] for row in rows] == [*range(13), *range(13)]
        assert any(row["right"] for row in rows if row["step"] in (0, 1))
