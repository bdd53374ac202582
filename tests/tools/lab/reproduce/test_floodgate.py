"""The maps of the flood gate: chains, tables, times, pictures, and the experiment as a whole."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.device.device import choose_device
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.floodgate import tables
from sonarmap.tools.lab.reproduce.floodgate.chain import (
    DISPLACED_90,
    MAP_90,
    MAP_MEDIAN,
    PAIR,
    TRUTH,
    FloodgateSurvey,
    by_run,
    chain_poses,
    chained,
    pair_row,
    pose_rows,
    transform,
)
from sonarmap.tools.lab.reproduce.floodgate.run import (
    Floodgate,
    FloodgateSettings,
)
from tests.samples.experiments.floodgate_rows import POSES, SCANS, STEPS, flat_survey, off, rows_of, turn
from tests.samples.experiments.shown import run_all, show


@pytest.fixture(scope="module")
def now() -> FloodgateSurvey:
    return flat_survey()


class TestChain:
    def test_one_wrong_step_moves_all_that_follow_alike(self, now: FloodgateSurvey) -> None:
        """The true motion after it hides nothing: each later pose is off by the same motion of the world."""
        assert np.allclose(chain_poses(POSES[0], STEPS).as_matrix(), POSES.as_matrix(), atol=1e-12)
        moved = (chain_poses(POSES[0], off(9.0)) * POSES.inv()).as_matrix()
        assert np.allclose(moved[:2], np.eye(4), atol=1e-12)
        assert np.allclose(moved[2:], moved[2], atol=1e-12)
        rows = pose_rows(now, off(9.0))
        assert [round(float(row["translation_m"]), 9) for row in rows] == [0, 0, 9, 9, 9]

    def test_a_rows_parameters_are_its_transform(self, now: FloodgateSurvey) -> None:
        expected = STEPS[2] * RigidTransform.from_components([1, -2, 0.5], turn(3, -7, 5))
        row = pair_row(now, 3, expected, accepted=False)
        assert np.allclose(transform(row, "found").as_matrix(), expected.as_matrix(), atol=1e-12)
        assert np.allclose(transform(row, "true").as_matrix(), STEPS[2].as_matrix(), atol=1e-12)
        assert row["translation_m"] == pytest.approx(np.sqrt(1 + 4 + 0.25))
        assert (row["right"], row["accepted"]) == (False, False)
        assert row["rotation_deg"] == pytest.approx(np.rad2deg(turn(3, -7, 5).magnitude()))
        assert [pair_row(now, 2, off(meters)[1], accepted=True)["right"] for meters in (5.99, 6.01)] == [True, False]

    def test_rows_come_back_as_poses(self, now: FloodgateSurvey) -> None:
        pairs = by_run(rows_of(now, {"icp": 9.0}), PAIR)["icp", 0]
        expected = POSES[0].inv() * chain_poses(POSES[0], off(9.0))
        assert np.allclose(chained(pairs, "found").as_matrix(), expected.as_matrix(), atol=1e-9)
        assert np.allclose(chained(pairs, "true").as_matrix(), (POSES[0].inv() * POSES).as_matrix(), atol=1e-9)


class TestMapError:
    def test_true_poses_leave_what_the_scans_have(self, now: FloodgateSurvey) -> None:
        """The first scan lies 0.25 m off, the others on the surface: the map so far is the mixture."""
        rows = pose_rows(now, None)
        medians, highs = ([float(row[name]) for row in rows] for name in (MAP_MEDIAN, MAP_90))
        assert [medians[0], *medians[2:]] == pytest.approx([0.25, 0, 0, 0], abs=1e-5)
        assert highs == pytest.approx([0.25] * SCANS, abs=1e-5)  # a fifth of the points, so beyond the 90th percentile

    def test_scans_lifted_off_their_surface(self, now: FloodgateSurvey) -> None:
        """Without a turn, all scans but the first two lie higher by what the second step has too much."""
        level = replace(now, T_world_sensor=RigidTransform.from_translation(POSES.translation))
        flat = [
            Scan((POSES[k].apply(scan.points.astype(float)) - POSES[k].translation).astype(np.float32), name=scan.name)
            for k, scan in enumerate(now.scans)
        ]
        steps = [level.step(k) for k in range(1, SCANS)]
        steps[1] = steps[1] * RigidTransform.from_translation([0, 0, 1.75])
        rows = pose_rows(replace(level, scans=tuple(flat)), steps)
        assert rows[1][MAP_MEDIAN] == pytest.approx(0.125, abs=0.13)
        assert (rows[-1][MAP_MEDIAN], rows[-1][MAP_90]) == pytest.approx((1.75, 1.75), abs=1e-4)

    def test_points_moved_along_the_surface_are_displaced_all_the_same(self, now: FloodgateSurvey) -> None:
        """The world is moved by 2 m along the lid after the first two scans; no distance tells of it."""
        moved = RigidTransform.from_translation([0, 2, 0]) * POSES
        rows = pose_rows(now, [STEPS[0], POSES[1].inv() * moved[2], *STEPS[2:]])
        assert [round(float(row[DISPLACED_90]), 6) for row in rows] == [0, 0, 2, 2, 2]
        assert rows[-1][MAP_90] == pytest.approx(0.25, abs=1e-5)


@pytest.fixture(scope="module")
def made(now: FloodgateSurvey) -> list[Row]:
    """Two surveys alike, with every method's one error."""
    errors = {"icp": 9.0, "planes": 0.8, "hemisphere": 4.0, "spectral": 0.4}
    return [row for seed in (1, 2) for row in rows_of(now, errors, seed)]


def verdicts_of(rows: Sequence[Row]) -> dict[str, str]:
    return {row[0]: row[-1] for row in tables.verdict_table(rows).rows}


class TestTables:
    def test_the_errors_of_every_run(self, made: list[Row]) -> None:
        """The ATE is after alignment: two poses of five are 9 m from the rest, which every one makes less than 9 m."""
        lines = {row[0]: row[1:] for row in tables.map_table(made).rows}
        assert lines["icp"][:3] == ("3 / 3", "3 / 3", "1 / 1")
        assert lines["hemisphere 256³"][:3] == ("4 / 4", "3 / 3", "0 / 0")
        assert lines["icp"][7:] == ("9.00 / 9.00", "0.0 / 0.0")
        assert lines[TRUTH][:3] == ("", "", "")
        icp, hemisphere = (float(lines[name][6].split()[0]) for name in ("icp", "hemisphere 256³"))
        assert 0 < hemisphere < icp < 9 * np.sqrt(0.24)

    def test_wrong_pairs_are_counted_in_brackets(self, made: list[Row]) -> None:
        rows = tables.pair_table(made).rows
        assert [row[0] for row in rows] == ["0 → 1", "1 → 2", "2 → 3", "3 → 4"]
        assert rows[1][1:4] == ("80 %", "70 %", "0.0°, 9.00 m [2]")
        assert rows[0][3] == "0.0°, 0.00 m"
        assert [row[1] for row in tables.pose_table(made).rows] == ["0.0°, 0.00 m", *["0.0°, 9.00 m"] * 3]

    def test_the_verdicts_follow_the_maps(self, now: FloodgateSurvey) -> None:
        """Maps so good, or so bad, as their errors say; the same rows with the names exchanged say the opposite."""
        good = verdicts_of(rows_of(now, {"icp": 9.0, "planes": 0.2, "spectral": 0.1}))
        assert (set(good.values()), len(good)) == ({"holds"}, 5)
        bad = verdicts_of(rows_of(now, {"icp": 0.2, "planes": 0.1, "spectral": 9.0}))
        assert bad.pop("the map by planes") == "holds"
        assert set(bad.values()) == {"does not hold"}
        some = verdicts_of([*rows_of(now, {"planes": 0.1}), *rows_of(now, {"planes": 9.0}, seed=2)])
        assert some == {"the map by planes": "holds in 1 of 2 surveys"}

    def test_two_grids_are_compared(self, now: FloodgateSurvey) -> None:
        coarse = [row for row in rows_of(now, {"spectral": 8.0}, fine=128) if row["method"] != TRUTH]
        rows = verdicts_of([*rows_of(now, {"spectral": 0.1}), *coarse])
        assert rows["spectral 128³ beside spectral 256³"] == "does not hold"
        assert rows["the map by spectral 256³"] == "holds"
        assert rows["the map by spectral 128³"] == "does not hold"

    def test_times_beside_the_papers_table(self) -> None:
        """As printed: seventeen pairs; least and largest as the text says."""
        paper = tables.PAPER_ICP
        assert (len(paper), min(paper), max(paper)) == (17, 1.27, 47.36)
        assert sum(paper) / 17 == pytest.approx(21.346, abs=5e-4)
        seconds = [
            {"method": method, "grid": grid, "scan": k + 1, "prepare_s": 0.5, "register_s": time}
            for method, grid in (("icp", 0), ("spectral", 256))
            for k, time in enumerate((2.0, 3.0, 6.0, 11.0))
        ]
        summary, pairs = tables.times_tables(seconds)
        assert ", ".join(summary.rows[0]) == "icp, , 1.27, 21.403, 47.36, 0.50, 2.00, 5.50, 4.50, 11.00, 2.44"
        assert pairs.rows[2] == ("2 → 3", "28.17", "6.00", "6.00")
        assert pairs.rows[-1] == ("average", "21.403", "5.500", "5.500")


class TestExperiment:
    @pytest.mark.slow
    def test_two_runs_give_the_same_rows_and_pictures(self, tmp_path: Path) -> None:
        """A map whose pairs were registered in an earlier run is the same as well."""
        settings = FloodgateSettings(methods=("icp", "hemisphere"), edges=(32,), seeds=1, first_seed=3, scans=3)
        made: list[tuple[list[Row], dict[str, bytes]]] = []
        for name in "ab":
            rows, seconds = run_all(experiment := Floodgate(settings, choose_device(None)))
            alone = Floodgate(settings, choose_device(None)).run("3/hemisphere/32/map")
            assert list(alone.rows) == rows[-len(alone.rows) :]
            show(experiment, tmp_path / name, rows, seconds)
            pictures = {path.name: path.read_bytes() for path in (tmp_path / name).iterdir()}
            assert all(len(content) < 300_000 for content in pictures.values())
            made.append((rows, pictures))
        assert made[0] == made[1]
