"""pairs.csv has a row for each pair and is read as written."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.pair import Pair
from sonarmap.tools.files.map_folder.names import read_pairs
from sonarmap.tools.files.readers.scans import read_scans
from sonarmap.tools.files.writers.points import write_ply
from sonarmap.tools.products.output.pairs_file import COLUMNS, write_pairs
from tests.samples.clutter_scans import table_of
from tests.samples.surveys import random_covariance, random_transforms, registration

COUNT = 50


@pytest.fixture(scope="module")
def pairs() -> list[Pair]:
    """Kept, refused and failed pairs with rotations of any angle; one is kept by an alternative."""
    rng = np.random.default_rng(3)
    T = random_transforms(rng, COUNT, angle=2.0, length=1e3)
    measured = [registration(T[k], random_covariance(rng), accepted=k % 3 > 0) for k in range(COUNT)]
    rows = [Pair(k, k + 1, "sequential", 0.1 * k, registration=measured[k], reason="refused") for k in range(COUNT)]
    rows[4] = replace(rows[4], edge=Edge(4, 5, measured[7], "sequential"), reason="kept, by an alternative", agreeing=2)
    rows[9] = Pair(9, 10, "bridge", failure="no", reason='failed: "a,\nb\udcff" is of no use')
    upright = RigidTransform.from_components([1, 2, 3], Rotation.from_euler("ZYX", [30, 90, 0], degrees=True))
    return [*rows, Pair(0, 1, "sequential", 0.0, registration=registration(upright, np.eye(6)), reason="refused")]


@pytest.fixture
def path(pairs: list[Pair], tmp_path: Path) -> Path:
    with pytest.warns(UserWarning, match="Gimbal lock"):
        write_pairs(tmp_path / "pairs.csv", pairs)
    return tmp_path / "pairs.csv"


def test_pairs_are_read_as_written(pairs: list[Pair], path: Path) -> None:
    for pair, read in zip(pairs, read_pairs(path, COUNT + 1), strict=True):
        assert (read.target, read.source, read.role, read.kept) == (pair.i, pair.j, pair.role, pair.kept)
        measured = pair.edge.registration if pair.edge else pair.registration
        assert (read.T_target_source is None) == (measured is None)
        if read.T_target_source is not None and measured:
            T = measured.T_target_source
            np.testing.assert_array_equal(read.T_target_source.translation, T.translation)
            np.testing.assert_allclose(read.T_target_source.as_matrix(), T.as_matrix(), atol=1e-14)


def test_a_row_holds_the_known_values(pairs: list[Pair], path: Path) -> None:
    rows = table_of(path)
    with path.open(newline="", encoding="utf-8") as file:
        assert next(csv.reader(file)) == list(COLUMNS)
    assert len(rows) == len(path.read_text().splitlines()) - 1 == len(pairs)
    failed, kept = rows[9], rows[4]
    assert {name for name, cell in failed.items() if cell} == {"target", "source", "role", "kept", "reason", "agreeing"}
    assert failed["reason"] == r'failed: "a, b\udcff" is of no use'
    assert (kept["kept"], kept["accepted"], kept["agreeing"], kept["alternatives"]) == ("yes", "yes", "2", "0")
    assert (float(kept["psr"]), float(kept["overlap"]), kept["probability"]) == (30, 0.6, "")
    # pyrefly: ignore[missing-attribute]
    covariance = pairs[7].registration.covariance
    rotation, translation = (np.linalg.eigvalsh(block)[-1] ** 0.5 for block in (covariance[:3, :3], covariance[3:, 3:]))
    assert float(kept["rotation_sigma_deg"]) == pytest.approx(np.degrees(rotation))
    assert float(kept["translation_sigma_m"]) == pytest.approx(translation)
    assert float(rows[5]["predicted_overlap"]) == 0.5


@pytest.mark.filterwarnings("error")
def test_a_covariance_of_nan_has_no_sigmas(tmp_path: Path) -> None:
    """A user's own method may return one; its pair then fails."""
    measured = registration(RigidTransform.from_translation([1, 2, 3]), np.full((6, 6), np.nan))
    write_pairs(tmp_path / "pairs.csv", [Pair(0, 1, "loop", registration=measured, reason="failed")])
    (row,) = table_of(tmp_path / "pairs.csv")
    assert (row["x_m"], row["rotation_sigma_deg"], row["translation_sigma_m"]) == ("1.0", "", "")


def test_without_pairs_only_the_heading_is_written_and_the_file_is_not_a_scan(path: Path) -> None:
    write_ply(path.parent / "scan.ply", np.eye(3))
    assert [scan.name for scan in read_scans([path.parent, str(path.parent / "*")]).scans] == ["scan"]
    for pairs in ([], [Pair(0, 1, "loop")]):
        write_pairs(path, pairs)
        assert [pair.T_target_source for pair in read_pairs(path, 2)] == [None for _ in pairs]
