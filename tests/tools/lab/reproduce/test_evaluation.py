"""The evaluation's experiments on a pair or two: which pairs they take, and that their rows are decided by these."""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.reproduce import methods
from sonarmap.tools.lab.reproduce.evaluation.pair_set import related, unrelated
from sonarmap.tools.lab.reproduce.evaluation.pairs import Pairs
from sonarmap.tools.lab.reproduce.evaluation.settings import PairSetSettings, PairsSettings, StepsSettings
from sonarmap.tools.lab.reproduce.evaluation.speed import Speed
from sonarmap.tools.lab.reproduce.evaluation.steps import Steps
from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome
from sonarmap.tools.lab.reproduce.experiments import EVALUATION, EXPERIMENTS, Request, chosen, create, members
from sonarmap.tools.lab.reproduce.methods import EVALUATED, ComparedMethods, compared_methods
from sonarmap.tools.lab.reproduce.pages.folder import section_text, verdicts
from sonarmap.tools.lab.reproduce.provenance import provenance
from sonarmap.tools.lab.reproduce.rows import all_rows, all_seconds
from sonarmap.tools.lab.reproduce.run import RunOptions, run
from sonarmap.tools.lab.reproduce.worker import WorkerProcesses
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
        from sonarmap.spectral.grid import Grid

        bounded, free = (
            methods.registrar("hemisphere", Grid(16, 1.0), device.selector, any_tilt=lifted) for lifted in (False, True)
        )
        assert (bounded.config.max_tilt, free.config.max_tilt) == (math.radians(35), math.pi)  # pyright: ignore
        methods.registrar("planes", Grid(16, 1.0), None, any_tilt=True)


class TestPairs:
    def test_the_overlap_is_that_without_noise(self) -> None:
        pairs = [related(number, 3, "yaw", 32) for number in (0, 2, 4)]
        shared = [float(pair.cells["shared"]) for pair in pairs if pair is not None]
        for share, low in zip(shared, (0.05, 0.4, 0.8), strict=True):
            assert low - 1e-4 <= share <= low + 0.2001

    def test_the_truth_lays_the_shared_points_on_each_other(self) -> None:
        pair = related(4, 3, "any", 32)
        assert pair is not None
        assert pair.truth is not None
        from scipy.spatial import KDTree

        distance, _ = KDTree(pair.target.points).query(pair.truth.apply(pair.source.points))
        assert np.median(distance) < pair.grid.voxel
        assert KDTree(pair.target.points).query(pair.source.points)[0].mean() > 3 * pair.grid.voxel

    def test_strangers_share_nothing_and_have_no_truth(self) -> None:
        pair = unrelated(1, 3, 32)
        assert pair is not None
        assert (pair.truth, pair.cells["shared"], pair.grid.edge) == (None, 0.0, 32)

    def test_jobs_do_not_depend_on_how_many_pairs_are_asked_for(self) -> None:
        few, many = (Pairs(PairsSettings(yaw=n, any=n), None) for n in (6, 20))
        assert set(few.jobs()) < set(many.jobs())
        assert len(few.jobs()) == 2 * 2 * len(EVALUATED)

    def test_other_methods_register_the_first_of_the_pairs(self) -> None:
        compared = ComparedMethods(("spectral", "kiss"))
        jobs = Pairs(PairsSettings(yaw=15, any=10, peers={"yaw": 6, "any": 40}, compared=compared), None).jobs()
        batches = ("yaw/000", "yaw/001", "yaw/002", "any/000", "any/001")
        assert [job for job in jobs if job.endswith("spectral")] == [f"{batch}/spectral" for batch in batches]
        assert [job for job in jobs if job.endswith("kiss")] == [f"{b}/kiss" for b in batches if b != "yaw/002"]

    def test_speed_leaves_out_what_shares_little(self) -> None:
        numbers = [int(job) for job in Speed(PairSetSettings(pairs=9), None).jobs()]
        assert numbers == [1, 2, 3, 4, 6, 7, 8, 9, 11]

    def test_seeds_go_round_over_the_scenes(self) -> None:
        kiss = ComparedMethods(("kiss",))
        settings = StepsSettings(("harbor", "pool"), (1.0, 2.0), seeds=3, first_seed=7, compared=kiss)
        assert list(Steps(settings, None).jobs()) == [
            f"{place}/{sigma2}/kiss" for place in ("harbor/7", "pool/8", "harbor/9") for sigma2 in ("1.0", "2.0")
        ]
        assert settings.grid.voxel == 2.0

    def test_other_methods_have_the_first_of_the_seeds(self) -> None:
        compared = ComparedMethods(("spectral", "kiss"))
        settings = StepsSettings(("harbor",), (1.0,), seeds=3, peers=1, first_seed=7, compared=compared)
        jobs = ("7/1.0/spectral", "7/1.0/kiss", "8/1.0/spectral", "9/1.0/spectral")
        assert list(Steps(settings, None).jobs()) == [f"harbor/{job}" for job in jobs]


@cache
def outcomes(name: str, device: Device) -> Mapping[str, Outcome]:
    """Of a tiny run."""
    experiment = tiny(name, device)
    return {job: experiment.run(job) for job in experiment.jobs()}


def tiny(name: str, device: Device) -> Experiment:
    methods = FEW[1:] if name == "unrelated" else FEW
    return create(name, request(device, method=methods, pairs=None if name == "steps" else 1))


SLOW_AND_QUICK = [*(pytest.param(name, marks=pytest.mark.slow) for name in ("steps", "pairs")), "unrelated", "speed"]


class TestRuns:
    @pytest.mark.parametrize("name", SLOW_AND_QUICK)
    @pytest.mark.slow
    def test_a_section_its_pictures_and_no_times_in_rows(self, name: str, device: Device, tmp_path: Path) -> None:
        experiment, done = tiny(name, device), outcomes(name, device)
        section = experiment.section(all_rows(done), all_seconds(done))
        verdicts(section)
        assert f"Methods: {', '.join(f'`{name}`' for name in experiment.settings.compared.methods)}." in section_text(
            section, 1
        )
        experiment.draw(tmp_path, all_rows(done))
        assert {path.name for path in tmp_path.iterdir()} == set(section.pictures)
        assert all_rows(done)
        assert not any(key.endswith("_s") or key == "seconds" for row in all_rows(done) for key in row)

    def test_speed_keeps_times_apart(self, device: Device) -> None:
        seconds = all_seconds(outcomes("speed", device))
        assert len(seconds) == len(FEW)
        assert all(float(row["register_s"]) > 0 and float(row["prepare_s"]) > 0 for row in seconds)

    def test_a_stranger_has_no_verdict(self, device: Device) -> None:
        assert all("right" not in row and "nees" not in row for row in all_rows(outcomes("unrelated", device)))

    @pytest.mark.slow
    def test_a_small_step_is_found(self, device: Device) -> None:
        rows = all_rows(outcomes("steps", device))
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
