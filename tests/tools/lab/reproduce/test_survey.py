"""Cells of mapped surveys, for given poses and pairs and for tiny maps."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.device.device import Device
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.map_folder.names import TriedPair
from sonarmap.tools.lab.reproduce import survey as simulated
from sonarmap.tools.lab.reproduce.experiments import Request, create
from sonarmap.tools.lab.reproduce.survey import RULES, USUAL, SimulatedSurvey, simulate_survey, survey_cells
from sonarmap.tools.lab.reproduce.survey_mapped import MappedSurvey
from sonarmap.tools.lab.simulate.plan import plan
from sonarmap.tools.lab.simulate.scenes.solids import Mesh
from tests.samples.scenes.simulated import COARSE, QUIET
from tests.samples.surveys import ring_poses

COUNT, VOXEL = 8, 0.5
UNUSABLE = 5
FLOOR = Mesh(np.array([[-99.0, -99, 0], [99, -99, 0], [0, 99, 0]]), np.array([[0, 1, 2]]))
ASIDE = RigidTransform.from_exp_coords([0.0, 0, 0.2, 3, 0, 1])
T_TRUTH_ESTIMATE = RigidTransform.from_exp_coords([0.3, -0.2, 1.0, 5, -2, 3])


def ring_survey() -> SimulatedSurvey:
    """Poses on a ring over a floor, in two dives of four."""
    truth = Trajectory(np.arange(float(COUNT)), ring_poses(COUNT))
    scans = tuple(Scan(np.zeros((1, 3), np.float32), stamp=float(k), name=str(k)) for k in range(COUNT))
    return SimulatedSurvey(scans, truth, np.repeat([0, 1], COUNT // 2), frozenset([UNUSABLE]), FLOOR)


def mapped(survey: SimulatedSurvey) -> MappedSurvey:
    """The true survey in another frame, except two wrong pairs; points of the map lie 0.3 m above the floor."""
    placed = [k for k in range(COUNT) if k != UNUSABLE]
    T = survey.truth.T_world_sensor
    pairs = (
        TriedPair(0, 1, "sequential", True, T[0].inv() * T[1]),
        TriedPair(1, 2, "sequential", False, T[1].inv() * T[2] * ASIDE),
        TriedPair(0, 7, "loop", True, T[0].inv() * T[7] * ASIDE),
        TriedPair(2, 6, "bridge", False, T[2].inv() * T[6]),
        TriedPair(4, UNUSABLE, "sequential", True, T[4].inv() * T[UNUSABLE]),
    )
    return MappedSurvey(
        placed=tuple(placed),
        trajectory=Trajectory(survey.truth.stamps[placed], T_TRUTH_ESTIMATE.inv() * T[placed]),
        pairs=pairs,
        points=T_TRUTH_ESTIMATE.inv().apply([[0.0, 0, 0.3], [1, 2, 0.3], [2, -3, 4.3]]),
        seen=np.array([2, 3, 1]),
        covariances=np.repeat(np.eye(6)[None], len(placed), axis=0),
    )


def test_cells_have_the_errors_in_the_true_frame_and_pairs_by_role_and_between_dives() -> None:
    row = survey_cells(ring_survey(), mapped(ring_survey()), VOXEL)
    assert row["ate_after_m"] == pytest.approx(0, abs=1e-9)
    assert (row["placed"], row["unusable"], row["placed_unusable"]) == (7, 1, 0)
    fates = ("kept_right", "kept_wrong", "refused_right", "refused_wrong")
    counts = [[row[f"{kind}_{fate}"] for fate in fates] for kind in ("sequential", "bridge", "loop", "between")]
    assert counts == [[1, 0, 0, 1], [0, 0, 1, 0], [0, 1, 0, 0], [0, 1, 1, 0]]
    assert (row["pairs"], row["unusable_kept"]) == (5, 1)
    assert (row["map_median_m"], row["map_twice_p90_m"]) == pytest.approx((0.3, 0.3), abs=1e-6)


def test_consecutive_dives_have_the_scans_of_each_dive_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    coarse = lambda *given: replace(plan(*given), sensor=COARSE, noise=QUIET)  # noqa: E731
    monkeypatch.setattr(simulated, "plan", coarse)
    both, second, first = (simulate_survey("floodgate", 3, 4, 0.25, dives) for dives in ((2, 1), (2,), (1,)))
    assert [scan.stamp for scan in both.scans] == both.truth.stamps.tolist() == [*map(float, range(8))]
    assert both.dives.tolist() == [0, 0, 0, 0, 1, 1, 1, 1]
    assert both.unusable == second.unusable | {k + 4 for k in first.unusable}
    assert len(both.unusable) == 2
    for k, (scan, alone) in enumerate(zip(both.scans, (*second.scans, *first.scans), strict=True)):
        assert np.array_equal(scan.points, alone.points), k


@pytest.mark.slow
def test_decisions_reuse_the_stored_registrations(device: Device, tmp_path: Path) -> None:
    settings = {"scenes": ("floodgate",), "seeds": 1, "first_seed": 5, "scans": 5, "edge": 64}
    request = Request(device, folder=tmp_path, settings=settings)
    (first, again) = (create("decisions", request).run("floodgate-5").rows for _ in range(2))
    rows = {row["rule"]: row for row in first}
    assert list(rows) == list(RULES)
    whole, chained = rows[USUAL], rows["without loops"]
    assert int(whole["registered"]) >= int(whole["pairs"]) > 4 == chained["pairs"]
    assert chained["loop_kept_right"] == 0 < int(whole["loop_kept_right"])
    assert list(again) == [{**row, "registered": 0} for row in rows.values()]
