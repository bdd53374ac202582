"""Real scans in folders: which pairs there are, in which files, and what is asked of them."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.reproduce.experiments import Request, chosen
from sonarmap.tools.lab.reproduce.real.real_set import read_sets, without_truth
from sonarmap.tools.lab.reproduce.real.run import Real
from sonarmap.tools.lab.reproduce.real.settings import RealSettings, real_settings
from sonarmap.tools.lab.simulate.sensing.navigation import KINDS
from tests.samples.experiments.real_folders import asked, gt_log, put, simulated

PRIORS = "name,roll_deg,pitch_deg,roll_sigma_deg,pitch_sigma_deg\n0,0,0,2,2\ncloud_bin_1.ply,1,1,2,2\n"


class TestSets:
    def test_a_folder_with_a_gt_log_is_one_set(self, tmp_path: Path) -> None:
        (real_set,) = read_sets(put(tmp_path / "quay"))
        (pair,) = real_set.pairs
        assert (real_set.name, real_set.priors, pair.name) == ("quay", None, "0-1")
        assert (pair.target.name, pair.source.name) == ("0.npy", "cloud_bin_1.ply")
        np.testing.assert_allclose(pair.T_target_source.as_matrix(), simulated()[2].as_matrix(), atol=1e-8)

    def test_folders_in_it_are_sets_in_natural_order_under_the_names_that_they_have_there(self, tmp_path: Path) -> None:
        for name in ("set10", "set2"):
            put(tmp_path / "all" / name)
        put(tmp_path / "elsewhere")
        (tmp_path / "all" / "a_link").symlink_to(tmp_path / "elsewhere")
        (tmp_path / "all" / "without").mkdir()
        assert [real_set.name for real_set in read_sets(tmp_path / "all")] == ["a_link", "set2", "set10"]
        assert without_truth(tmp_path / "all") == ("without",)
        assert without_truth(tmp_path / "elsewhere") == ()

    def test_the_digest_is_of_all_that_decides_and_of_nothing_else(self, tmp_path: Path) -> None:
        def digest() -> str:
            return read_sets(folder)[0].digest

        folder = put(tmp_path / "a")
        first = digest()
        assert read_sets(put(tmp_path / "b"))[0].digest == first
        (folder / "README.md").write_text("hello")
        np.save(folder / "2.npy", np.ones((9, 3)))
        assert digest() == first
        seen = {first}
        np.save(folder / "0.npy", simulated()[0].points[1:])
        seen.add(digest())
        (folder / "gt.log").write_text(gt_log(0, 1, RigidTransform.identity()))
        seen.add(digest())
        (folder / "priors.csv").write_text(PRIORS)
        seen.add(digest())
        (folder / "0.tum").write_text("0 0 0 0 0 0 0 1\n")
        seen.add(digest())
        assert len(seen) == 5

    def test_folders_that_cannot_be_used(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match=r"there is no folder .*none; give one that holds scans and a gt.log"):
            read_sets(tmp_path / "none")
        (tmp_path / "a").mkdir()
        with pytest.raises(InputError, match=r"nor a folder in it has a gt\.log; wanted for every pair"):
            read_sets(tmp_path)
        folder = put(tmp_path / "a")
        (folder / "gt.log").write_text(gt_log(0, 12, simulated()[2]))
        with pytest.raises(InputError, match=r"line 1 names the scan 12, and no scan .* as 12\.ply"):
            read_sets(folder)
        (folder / "gt.log").write_text(gt_log(0, 1, simulated()[2]))
        shutil.copy(folder / "0.npy", folder / "old_1.npy")
        with pytest.raises(InputError, match=r"names of 2 scans end in it: cloud_bin_1\.ply and old_1\.npy; move one"):
            read_sets(folder)


class TestRequest:
    def test_the_folder_is_needed_by_real_alone(self, tmp_path: Path) -> None:
        assert chosen("real", Request(folder=tmp_path)) == ("real",)
        with pytest.raises(InputError, match="reproduce real needs the folder of the scans"):
            chosen("real", Request())
        for name in ("pairs", "all", "evaluation"):
            with pytest.raises(InputError, match=f"reproduce {name} simulates its scans, so the folder"):
                chosen(name, Request(folder=tmp_path))
        assert "real" not in chosen("all", Request())

    def test_the_command_does_not_say_where_the_folder_lies(self, tmp_path: Path) -> None:
        request = Request(folder=tmp_path, voxel=0.25, max_tilt=20.0, known="attitude,depth", known_sigmas="1,2,3,4")
        assert request.command("real") == (
            "sonarmap reproduce real DIR --voxel 0.25 --max-tilt 20.0 --known attitude,depth --known-sigmas 1,2,3,4"
        )

    def test_options_become_settings(self) -> None:
        request = Request(known="depth,attitude", known_sigmas="1,2,3,4", seeds=2, seed=7, max_tilt=180.0, grid=64)
        settings = real_settings(request, {"a": "b"})
        assert (settings.known, settings.max_tilt, settings.edge) == (("attitude", "depth"), 180.0, 64)
        assert settings.draws == {"attitude=1,depth=3,seed=7": 7, "attitude=1,depth=3,seed=8": 8}
        np.testing.assert_allclose(
            settings.instruments.sigmas, [np.deg2rad(1), np.deg2rad(1), np.inf, np.inf, np.inf, 3]
        )

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"known": "compass"}, "no instrument measures 'compass'"),
            ({"known": ""}, "no instrument measures ''"),
            ({"known_sigmas": "1,2,3,4"}, "--known-sigmas has no effect without --known"),
            ({"seed": 4}, "--seed has no effect without --known"),
            ({"known": "depth", "known_sigmas": "1,2,3"}, "standard deviations are 1, 2, 3; wanted four numbers"),
            ({"known": "depth", "known_sigmas": "1,2,x,4"}, "standard deviations are nan; wanted four numbers"),
            ({"known": "depth", "known_sigmas": "1,2,0,4"}, "wanted four numbers above 0"),
            ({"max_tilt": 0.0}, "largest tilt is 0 degrees"),
            ({"voxel": -1.0}, "voxel=-1"),
            ({"grid": 33}, "edge=33"),
        ],
    )
    def test_options_that_cannot_be_used(self, options: dict, message: str) -> None:
        with pytest.raises(InputError, match=message):
            real_settings(Request(**options), {})


class TestJobs:
    def test_methods_that_use_priors_run_with_what_is_known_and_without(self, tmp_path: Path) -> None:
        folder = put(tmp_path / "quay")
        (folder / "priors.csv").write_text(PRIORS)
        sets = read_sets(folder)
        request = asked(folder, method=("spectral", "planes"), known="heading", seeds=2)
        experiment = Real(sets, real_settings(request, {"quay": sets[0].digest}), None)
        key = f"quay@{sets[0].digest[:8]}/0-1"
        assert experiment.jobs() == [
            f"{key}/nothing/spectral",
            f"{key}/nothing/planes",
            f"{key}/priors.csv/spectral",
            f"{key}/heading=3,seed=0/spectral",
            f"{key}/heading=3,seed=1/spectral",
        ]

    def test_drawn_priors_are_about_the_truth_and_the_same_again(self, tmp_path: Path) -> None:
        sets = read_sets(put(tmp_path / "quay"))
        settings = RealSettings({}, known=KINDS, sigmas=(0.01, 0.02, 0.03, 0.04), seeds=3)
        drawn = []
        for known in settings.draws:
            experiment = Real(sets, settings, None)
            read = experiment._scans(sets[0].pairs[0].target, sets[0].pairs[0].source)[:2]
            target, source = experiment._with_priors(read, sets[0], sets[0].pairs[0], known)
            again = experiment._with_priors(read, sets[0], sets[0].pairs[0], known)
            assert target.prior is not None
            assert source.prior is not None
            relative = target.prior.T_world_sensor.inv() * source.prior.T_world_sensor
            error = relative.inv() * simulated()[2]
            assert 0 < np.rad2deg(error.rotation.magnitude()) < 0.15
            assert 0 < np.linalg.norm(error.translation) < 0.3
            drawn.append(source.prior.T_world_sensor.as_matrix())
            assert again[1].prior is not None
            np.testing.assert_array_equal(again[1].prior.T_world_sensor.as_matrix(), drawn[-1])
        assert not np.allclose(drawn[0], drawn[1], atol=1e-6)

    def test_the_files_priors_are_used(self, tmp_path: Path) -> None:
        folder = put(tmp_path / "quay")
        (folder / "priors.csv").write_text(PRIORS)
        sets = read_sets(folder)
        experiment = Real(sets, RealSettings({}), None)
        read = experiment._scans(sets[0].pairs[0].target, sets[0].pairs[0].source)[:2]
        scans = experiment._with_priors(read, sets[0], sets[0].pairs[0], "priors.csv")
        assert [scan.prior is not None and scan.prior.knows_attitude for scan in scans] == [True, True]
        assert [scan.prior for scan in experiment._with_priors(read, sets[0], sets[0].pairs[0], "nothing")] == [
            None
        ] * 2
