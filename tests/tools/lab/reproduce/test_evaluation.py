"""The evaluation's experiments on a pair or two: which pairs they take, and that their rows are decided by these."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.reproduce import methods
from sonarmap.tools.lab.reproduce.evaluation.pair_set import related, unrelated
from sonarmap.tools.lab.reproduce.evaluation.pairs import Pairs
from sonarmap.tools.lab.reproduce.evaluation.settings import PairSetSettings, PairsSettings, StepsSettings
from sonarmap.tools.lab.reproduce.evaluation.speed import Speed
from sonarmap.tools.lab.reproduce.evaluation.steps import Steps
from sonarmap.tools.lab.reproduce.experiment import Experiment, Row
from sonarmap.tools.lab.reproduce.experiments import EVALUATION, EXPERIMENTS, Request, chosen, create, members
from sonarmap.tools.lab.reproduce.methods import EVALUATED, ComparedMethods, compared_methods
from sonarmap.tools.lab.reproduce.pages.folder import section_text
from sonarmap.tools.lab.reproduce.provenance import provenance
from sonarmap.tools.lab.reproduce.run import RunOptions, run
from sonarmap.tools.lab.reproduce.worker import WorkerProcesses
from tests.samples.experiments.shown import run_all, show
from tests.tools.lab.reproduce.test_run import silence

FEW = ("hemisphere", "planes")
NAMES = ("steps", "pairs", "unrelated", "speed")


def request(device: Device, **changes: object) -> Request:
    return Request(device, True, **{"grid": 32, "method": FEW, **changes})  # pyright: ignore[reportArgumentType]


class TestGroup:
    def test_all_is_the_papers_and_evaluation_is_ours(self) -> None:
        assert chosen("all", Request()) == ("translation", "rotation", "limits", "gaussian", "floodgate")
        assert chosen("evaluation", Request()) == members(EVALUATION) == NAMES
        assert chosen("evaluation", Request(method=("kiss",), grid=64)) == NAMES
        assert [name for name in EXPERIMENTS if EXPERIMENTS[name].timed] == ["speed", "survey", "scale"]

    def test_options_without_effect_are_refused(self) -> None:
        with pytest.raises(InputError, match="--scene has no effect"):
            chosen("evaluation", Request(scene="harbor"))
        with pytest.raises(InputError, match="--method has no effect"):
            chosen("gaussian", Request(method=("kiss",)))
        assert Request(method=("kiss", "icp"), pairs=7).command("pairs") == (
            "sonarmap reproduce pairs --pairs 7 --method kiss --method icp"
        )


class TestComparedMethods:
    def test_what_is_not_installed_is_left_out_and_said(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(methods, "is_installed", lambda name: name != "kiss")
        compared = compared_methods(Request())
        assert compared == ComparedMethods(tuple(name for name in EVALUATED if name != "kiss"), ("kiss",))
        assert "Left out, as their packages are not installed: `kiss`" in compared.words

    def test_a_method_that_is_asked_for_and_not_installed_is_refused(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def missing(*_: object) -> None:
            raise InputError("the method kiss needs the package kiss-matcher")

        monkeypatch.setattr(methods, "is_installed", lambda name: name != "kiss")
        monkeypatch.setattr(methods, "registrar", missing)
        with pytest.raises(InputError, match="kiss-matcher"):
            compared_methods(Request(method=("kiss",)))

    def test_the_bound_on_tilt_is_lifted_where_there_is_one(self, device: Device) -> None:
        bounded, free = (
            methods.registrar("hemisphere", Grid(16, 1.0), device.selector, any_tilt=lifted) for lifted in (False, True)
        )
        assert (bounded.config.max_tilt, free.config.max_tilt) == (math.radians(35), math.pi)  # pyright: ignore
        methods.registrar("planes", Grid(16, 1.0), None, any_tilt=True)


class TestPairs:
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
        # speed leaves out what shares little
        numbers = [int(job) for job in Speed(PairSetSettings(pairs=9), None).jobs()]
        assert numbers == [1, 2, 3, 4, 6, 7, 8, 9, 11]

    def test_other_methods_register_the_first_of_the_pairs_and_seeds(self) -> None:
        compared = ComparedMethods(("spectral", "kiss"))
        jobs = Pairs(PairsSettings(yaw=15, any=10, peers={"yaw": 6, "any": 40}, compared=compared), None).jobs()
        batches = ("yaw/000", "yaw/001", "yaw/002", "any/000", "any/001")
        assert [job for job in jobs if job.endswith("spectral")] == [f"{batch}/spectral" for batch in batches]
        assert [job for job in jobs if job.endswith("kiss")] == [f"{b}/kiss" for b in batches if b != "yaw/002"]
        settings = StepsSettings(("harbor",), (1.0,), seeds=3, peers=1, first_seed=7, compared=compared)
        jobs = ("7/1.0/spectral", "7/1.0/kiss", "8/1.0/spectral", "9/1.0/spectral")
        assert list(Steps(settings, None).jobs()) == [f"harbor/{job}" for job in jobs]

    def test_seeds_go_round_over_the_scenes(self) -> None:
        kiss = ComparedMethods(("kiss",))
        settings = StepsSettings(("harbor", "pool"), (1.0, 2.0), seeds=3, first_seed=7, compared=kiss)
        assert list(Steps(settings, None).jobs()) == [
            f"{place}/{sigma2}/kiss" for place in ("harbor/7", "pool/8", "harbor/9") for sigma2 in ("1.0", "2.0")
        ]
        assert settings.grid.voxel == 2.0


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
        methods = ", ".join(f"`{method}`" for method in experiment.settings.compared.methods)
        assert f"Methods: {methods}." in section_text(show(experiment, tmp_path, rows, seconds), 1)

    def test_speed_keeps_times_apart(self, device: Device) -> None:
        seconds = done("speed", device)[1]
        assert len(seconds) == len(FEW)
        assert all(float(row["register_s"]) > 0 and float(row["prepare_s"]) > 0 for row in seconds)

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
        assert provenance(create("speed", request(device, pairs=1)), device).methods == {}
