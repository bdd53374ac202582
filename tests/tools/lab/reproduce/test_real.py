"""Real scans in folders: sets of pairs, their digests, and refused folders."""

import shutil
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.tools.lab.reproduce.real import read_sets, without_truth
from tests.samples.experiments.real_folders import gt_log, put, simulated
from tests.samples.refusals import refuses


class TestSets:
    def test_a_folder_with_a_gt_log_is_one_set(self, tmp_path: Path) -> None:
        (real_set,) = read_sets(put(tmp_path / "quay"))
        (pair,) = real_set.pairs
        assert (real_set.name, real_set.priors, pair.name) == ("quay", None, "0-1")
        assert (pair.target.name, pair.source.name) == ("0.npy", "cloud_bin_1.ply")
        np.testing.assert_allclose(pair.T_target_source.as_matrix(), simulated()[2].as_matrix(), atol=1e-8)

    def test_subfolders_are_sets_in_natural_order(self, tmp_path: Path) -> None:
        for name in ("set10", "set2"):
            put(tmp_path / "all" / name)
        put(tmp_path / "elsewhere")
        (tmp_path / "all" / "a_link").symlink_to(tmp_path / "elsewhere")
        (tmp_path / "all" / "without").mkdir()
        assert [real_set.name for real_set in read_sets(tmp_path / "all")] == ["a_link", "set2", "set10"]
        assert without_truth(tmp_path / "all") == ("without",)
        assert without_truth(tmp_path / "elsewhere") == ()

    def test_the_digest_covers_only_files_that_are_read(self, tmp_path: Path) -> None:
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
        for name, text in {"gt.log": truth, "priors.csv": "name,roll_deg\n0,0\n"}.items():
            (folder / name).write_text(text)
            seen.add(digest())
        assert len(seen) == 4

    def test_unusable_folders_are_refused(self, tmp_path: Path) -> None:
        refuses(r"there is no folder .*none; give one that holds scans and a gt.log", read_sets, tmp_path / "none")
        (tmp_path / "a").mkdir()
        refuses(r"nor a folder in it has a gt\.log; wanted for every pair", read_sets, tmp_path)
        folder = put(tmp_path / "a")
        (folder / "gt.log").write_text(gt_log(0, 12, simulated()[2]))
        refuses(r"line 1 names the scan 12, and no scan .* as 12\.ply", read_sets, folder)
        (folder / "gt.log").write_text(gt_log(0, 1, simulated()[2]))
        shutil.copy(folder / "0.npy", folder / "old_1.npy")
        refuses(r"names of 2 scans end in it: cloud_bin_1\.ply and old_1\.npy; move one", read_sets, folder)
