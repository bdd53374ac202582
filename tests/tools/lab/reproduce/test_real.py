"""Real scans in folders: pairs, files, options, rows, tables, and what makes jobs run again."""

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from typer.testing import CliRunner

from sonarmap.kernels.device.device import Device
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.command.main import app
from sonarmap.tools.lab.reproduce.experiments import create
from sonarmap.tools.lab.reproduce.real.real_set import RealSet, read_sets, without_truth
from sonarmap.tools.lab.reproduce.real.run import Real
from sonarmap.tools.lab.reproduce.real.settings import RealSettings
from sonarmap.tools.lab.simulate.sensing.navigation import KINDS
from tests.samples.experiments.real_folders import asked, gt_log, put, simulated
from tests.samples.places import DATA
from tests.samples.refusals import refuses

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
        def digest(of: str = "a") -> str:
            return read_sets(tmp_path / of)[0].digest

        folder = put(tmp_path / "a")
        first = digest()
        put(tmp_path / "b")
        assert digest("b") == first
        (folder / "README.md").write_text("hello")
        np.save(folder / "2.npy", np.ones((9, 3)))
        assert digest() == first
        np.save(folder / "0.npy", simulated()[0].points[1:])
        seen = {first, digest()}
        truth = gt_log(0, 1, RigidTransform.identity())
        for name, text in {"gt.log": truth, "priors.csv": PRIORS, "0.tum": "0 0 0 0 0 0 0 1\n"}.items():
            (folder / name).write_text(text)
            seen.add(digest())
        assert len(seen) == 5

    def test_folders_that_cannot_be_used(self, tmp_path: Path) -> None:
        refuses(r"there is no folder .*none; give one that holds scans and a gt.log", read_sets, tmp_path / "none")
        (tmp_path / "a").mkdir()
        refuses(r"nor a folder in it has a gt\.log; wanted for every pair", read_sets, tmp_path)
        folder = put(tmp_path / "a")
        (folder / "gt.log").write_text(gt_log(0, 12, simulated()[2]))
        refuses(r"line 1 names the scan 12, and no scan .* as 12\.ply", read_sets, folder)
        (folder / "gt.log").write_text(gt_log(0, 1, simulated()[2]))
        shutil.copy(folder / "0.npy", folder / "old_1.npy")
        refuses(r"names of 2 scans end in it: cloud_bin_1\.ply and old_1\.npy; move one", read_sets, folder)


def priors_of(sets: Sequence[RealSet], settings: RealSettings, known: str) -> list[PosePrior | None]:
    """Of both scans of the first pair."""
    experiment, pair = Real(sets, settings, None), sets[0].pairs[0]
    read = experiment.scans(pair.target, pair.source)[:2]
    return [scan.prior for scan in experiment._with_priors(read, sets[0], pair, known)]


class TestJobs:
    def test_drawn_priors_are_about_the_truth_and_the_same_again(self, tmp_path: Path) -> None:
        sets = read_sets(put(tmp_path / "quay"))
        settings = RealSettings({}, known=KINDS, sigmas=(0.01, 0.02, 0.03, 0.04), seeds=3)
        drawn = []
        for known in settings.draws:
            first, again = (
                [prior.T_world_sensor for prior in priors_of(sets, settings, known) if prior] for _ in range(2)
            )
            error = (first[0].inv() * first[1]).inv() * simulated()[2]
            assert 0 < np.rad2deg(error.rotation.magnitude()) < 0.15
            assert 0 < np.linalg.norm(error.translation) < 0.3
            drawn.append(first[1].as_matrix())
            np.testing.assert_array_equal(again[1].as_matrix(), drawn[-1])
        assert not np.allclose(drawn[0], drawn[1], atol=1e-6)

    def test_the_files_priors_are_used(self, tmp_path: Path) -> None:
        folder = put(tmp_path / "quay")
        (folder / "priors.csv").write_text(PRIORS)
        given, none = (priors_of(read_sets(folder), RealSettings({}), known) for known in ("priors.csv", "nothing"))
        assert [prior is not None and prior.knows_attitude for prior in given] == [True, True]
        assert none == [None, None]


class TestRuns:
    @pytest.mark.slow
    def test_a_registration_of_the_truth_is_right_and_a_turned_truth_makes_it_wrong(
        self, tmp_path: Path, device: Device
    ) -> None:
        folder = put(tmp_path / "quay")
        rows = []
        for degrees in (0, 20):
            turn = RigidTransform.from_rotation(Rotation.from_euler("Z", degrees, degrees=True))
            (folder / "gt.log").write_text(gt_log(0, 1, simulated()[2] * turn))
            experiment = create("real", asked(folder, device, method=("planes",), voxel=2.0))
            (job,) = experiment.jobs()
            rows.append(experiment.run(job).rows[0])
        assert [row["right"] for row in rows] == [True, False]
        assert abs(float(rows[1]["rotation_deg"]) - 20) < 3
        assert [row["voxel_m"] for row in rows] == [2.0, 2.0]


class TestCommand:
    @pytest.mark.slow
    def test_a_folder(self, tmp_path: Path, device: Device) -> None:
        put(tmp_path / "in" / "quay")
        arguments = ["reproduce", "real", str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--grid", "32", "-q"]
        arguments += ["--method", "planes", "--device", device.selector]
        result = CliRunner().invoke(app, arguments)
        assert result.exit_code == 0, result.output
        page = (tmp_path / "out" / "real.md").read_text()
        assert page.startswith("# Pairs of real scans\n")
        assert "\nsonarmap reproduce real DIR --grid 32 --method planes\n" in page
        assert str(tmp_path) not in page
        assert (tmp_path / "out" / "real.png").is_file()


@pytest.mark.slow
def test_real_development_data(tmp_path: Path, device: Device) -> None:
    if not (DATA / "real").is_dir():
        pytest.skip(f"no real scans in {DATA / 'real'}")
    (tmp_path / "pool").mkdir()
    for path in (DATA / "real" / "pool").glob("*.npy"):
        (tmp_path / "pool" / path.name).symlink_to(path)
    T = RigidTransform.from_components([-1.07, -1.16, 0], Rotation.from_euler("Z", 28.5, degrees=True))
    (tmp_path / "pool" / "gt.log").write_text(gt_log(1, 2, T))
    for name, place in {"kitti07": "real/kitti07", "outdoor": "real/outdoor", "kitchen": "redkitchen"}.items():
        (tmp_path / name).symlink_to(DATA / place)
    experiment = create("real", asked(tmp_path, device, grid=128, method=("spectral",)))
    rows = [experiment.run(job).rows[0] for job in experiment.jobs()]
    assert {(row["set"], row["pair"]) for row in rows} == {
        *(("kitchen", pair) for pair in ("0-1", "0-2", "1-2")),
        *(("kitti07", pair) for pair in ("0-2", "0-3", "2-3")),
        *(("outdoor", pair) for pair in ("0-1", "0-2")),
        ("pool", "1-2"),
    }
    single = [row for row in rows if row["set"] in ("outdoor", "kitchen")]
    assert all(row["right"] and row["accepted"] for row in single)
    assert not any(row["accepted"] and not row["right"] for row in rows)
