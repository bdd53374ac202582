"""Distances between two surveys: a known change, no change, other frames, and areas that one survey saw alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.slam.graph.tangent import lengths
from sonarmap.tools.products.compare.comparison import Comparison, agreed
from sonarmap.tools.products.compare.detection import Verdict, distances_between, regions_of
from sonarmap.tools.products.compare.surface import RADIUS, cores_of, layer_of
from tests.samples.surveys import drawn
from tests.tools.products.compare.made_up import ALIGNMENT, NOISE, VOXEL, bed, compared, surveyed


def test_distances_equal_those_of_m3c2(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # where it writes its log
    import py4dgeo

    old, new = surveyed(1, weight=1.0), surveyed(2, change=0.4, weight=1.0)
    cores = cores_of(old, VOXEL)
    cores = cores.take(np.abs(cores.points[:, :2]).max(axis=1) < 14)
    ours = layer_of(new, cores, VOXEL, 1.0).height - layer_of(old, cores, VOXEL, 1.0).height
    m3c2 = py4dgeo.M3C2(
        epochs=(py4dgeo.Epoch(old.points), py4dgeo.Epoch(new.points)),
        corepoints=cores.points,
        cyl_radius=RADIUS * VOXEL,
        max_distance=1.0 + 1.5 * VOXEL,
        corepoint_normals=cores.normals,
    )
    np.testing.assert_allclose(ours, m3c2.run()[0], atol=1e-9)


@pytest.mark.quick_cases(1)
@pytest.mark.parametrize("seed", range(3))
def test_noise_and_pose_errors_are_not_a_change(seed: int) -> None:
    distances = compared(surveyed(2 * seed + 10), surveyed(2 * seed + 11))
    false = np.isin(distances.verdict, (Verdict.GAINED, Verdict.LOST))
    assert false[distances.compared].mean() <= 0.06  # at a 95 % level of detection
    assert not regions_of(distances)
    # pose errors are larger than the distances that remain
    assert np.median(np.abs(distances.distance[distances.compared])) < NOISE


def test_a_survey_is_unchanged_against_itself() -> None:
    """Equal normals have a cosine of 1, or above it by rounding."""
    survey = surveyed(10)
    distances = distances_between(survey, survey, None, VOXEL, 4 * VOXEL, 2 * VOXEL)
    assert np.isfinite(distances.level[distances.compared]).all()
    assert (distances.verdict == Verdict.UNCHANGED).mean() > 0.95
    apart = Comparison("old", "new", None, replace(distances, compared=np.arange(0)), ())
    assert "level of detection unknown" in str(apart)
    assert "nan" not in str(apart)


def test_bent_scans_are_not_a_change() -> None:
    """As by motion during a scan: half of one survey has waves of six voxels and 0.2 m."""
    new = surveyed(11)
    wave = np.sin(new.points[:, :2] * np.pi / (6 * VOXEL)).prod(axis=1) * (new.points[:, 0] > 0)
    distances = compared(surveyed(10), replace(new, points=new.points + 0.2 * wave[:, None] * [0, 0, 1]))
    assert distances.together > 2
    assert not regions_of(distances)
    assert regions_of(replace(distances, together=1.0))


@pytest.mark.parametrize("change", [0.4, -0.4])
def test_a_known_change_is_one_region_with_its_volume(change: float) -> None:
    distances = compared(surveyed(5), surveyed(6, change=change))
    points = distances.cores.points
    within = (np.abs(points[:, :2]) < 2).all(axis=1)
    verdict = Verdict.GAINED if change > 0 else Verdict.LOST
    assert (distances.verdict[within] == verdict).mean() > 0.95
    np.testing.assert_allclose(distances.distance[within].mean(), change, atol=0.05)
    (region,) = regions_of(distances)
    assert abs(region.volume - 36 * change) < 2 * region.sigma < 0.5 * abs(36 * change)
    assert region.gained == (change > 0)
    assert np.abs(region.place[:2]).max() < 0.5
    assert (region.low[:2] > -4).all()


def test_a_partly_hidden_heap_has_a_larger_sigma() -> None:
    """Its volume is too small, within the sigma; where both surveys saw everything, no area is unseen."""
    old, new = surveyed(5, change=0.6), surveyed(6)
    hidden = (np.abs(old.points[:, 1]) < 3) & (old.points[:, 0] > 0) & (old.points[:, 0] < 3)
    seen = replace(
        old, **{name: getattr(old, name)[~hidden] for name in ("points", "noise", "weight", "scan", "origins")}
    )
    (whole,), (half,) = regions_of(compared(old, new)), regions_of(compared(seen, new))
    assert whole.unseen < 1 < 12 < half.unseen < 18
    assert whole.sigma < 3 < abs(half.volume + 36 * 0.6) < 2.5 * half.sigma  # the hidden part is as high


@pytest.mark.parametrize(("looked_through", "lost"), [(False, True), (True, False)])
def test_a_surface_above_another_is_a_change_where_the_other_survey_looked_through_it(
    looked_through: bool, lost: bool
) -> None:
    """A pontoon above the bed: a survey from the side sees the bed below it, one from above only its top."""
    bare, covered = surveyed(5), surveyed(6, change=1.9)
    if not looked_through:
        bare = replace(bare, origins=np.tile([-16.0, 0.0, 1.5], (len(bare.points), 1)))
    distances = compared(covered, bare) if lost else compared(bare, covered)
    within = np.isfinite(distances.distance) & (np.abs(distances.cores.points[:, :2]) < 2).all(axis=1)
    assert np.median(np.abs(distances.distance[within])) == pytest.approx(1.9, abs=0.1)
    assert bool(regions_of(distances)) == looked_through
    doubtful = distances.verdict[within] == Verdict.UNSURE
    assert doubtful.mean() < 0.5 if looked_through else doubtful.all()  # strips of two scans meet below


def test_a_change_is_not_absorbed_by_its_scan() -> None:
    """A third of the area moves by more than the pose errors; the other scans fix its position."""
    distances = compared(surveyed(7), surveyed(8, change=0.5, half=7.5))
    within = (np.abs(distances.cores.points[:, :2]) < 6).all(axis=1)
    np.testing.assert_allclose(np.median(distances.distance[within]), 0.5, atol=0.08)


def test_areas_of_one_survey_alone_are_old_only_or_new_only() -> None:
    distances = compared(surveyed(1, size=15.0), surveyed(2, size=10.0))
    beyond = np.abs(distances.cores.points[:, :2]).max(axis=1) > 11
    assert (distances.verdict[beyond] == Verdict.OLD_ONLY).all()
    other = compared(surveyed(2, size=10.0), surveyed(1, size=15.0))
    far = np.abs(other.cores.points[:, :2]).max(axis=1) > 13
    assert far.any()
    assert (other.verdict[far] == Verdict.NEW_ONLY).all()
    assert np.isnan(other.distance[far]).all()


def test_the_result_does_not_depend_on_the_frame() -> None:
    old, new = surveyed(3), surveyed(4, change=0.4)
    T = RigidTransform.from_components([40.0, -20.0, 5.0], Rotation.from_euler("z", 90, degrees=True))
    original, turned = compared(old, new), compared(old.moved(T), new.moved(T))
    assert regions_of(turned)[0].volume == pytest.approx(regions_of(original)[0].volume, rel=0.1)
    assert np.nanmedian(turned.level) == pytest.approx(np.nanmedian(original.level), rel=0.1)


def test_a_shift_along_the_surface_is_not_a_change() -> None:
    """A rotation about a distant point shifts the bed by 1.6 m; noisy normals turn that into distances."""
    away = RigidTransform.from_translation([400.0, 0.0, 0.0])
    old, new = (surveyed(k + 30, size=20.0).moved(away) for k in range(2))
    turned = new.moved(RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, 4e-3])))
    distances = distances_between(old, turned, np.diag(np.repeat([5e-3, 0.5], 3) ** 2), VOXEL, 2.0, 1.0)
    assert distances.widened < 1.2
    assert not regions_of(distances)


def test_surveys_of_one_map_have_smaller_joint_sigmas() -> None:
    old, new = surveyed(3, poses_err=False), surveyed(4, poses_err=False)
    joint = distances_between(old, new, None, VOXEL, 4 * VOXEL, 2 * VOXEL)
    apart = compared(old, new)
    assert joint.shared.shape[1] == len(old.covariance)
    every = np.arange(len(apart.compared))
    assert joint.sigma_of_sum(every) < apart.sigma_of_sum(every)


def test_pose_errors_are_correlated_between_points() -> None:
    distances = compared(surveyed(3), surveyed(4))
    every = np.arange(len(distances.compared))
    apart = np.sqrt(np.sum((distances.cores.area * distances.sigma)[distances.compared] ** 2))
    assert distances.sigma_of_sum(every) > 3 * apart


def test_a_level_above_the_bound_is_unsure() -> None:
    old, new = surveyed(1, size=5.0), surveyed(2, size=5.0)
    distances = distances_between(old, new, ALIGNMENT, VOXEL, 4 * VOXEL, bound=1e-3)
    assert not (distances.verdict == Verdict.UNCHANGED).any()
    assert (distances.verdict == Verdict.UNSURE).any()


@pytest.mark.slow
def test_core_points_cover_the_surface_once() -> None:
    cores = cores_of(surveyed(1, poses_err=False), VOXEL)
    assert cores.area.sum() == pytest.approx(30 * 30, rel=0.05)
    assert (cores.normals[:, 2] > 0.9).all()  # toward the sensors
    assert np.abs(cores.points[:, 2] - bed(cores.points[:, :2])).std() < NOISE


COVARIANCE = np.diag(np.repeat([3e-3, 0.05], 3) ** 2)
TRUTH = RigidTransform.from_exp_coords([0.1, -0.05, 1.2, 8.0, -3.0, 1.0])


def alignments(seed: int, count: int, truth: RigidTransform = TRUTH) -> list[tuple[RigidTransform, np.ndarray]]:
    errors = drawn(np.random.default_rng(seed), COVARIANCE, count)
    return [(errors[k] * truth, COVARIANCE) for k in range(count)]


def test_the_majority_of_alignments_is_taken() -> None:
    wrong = alignments(2, 3, RigidTransform.from_translation([30.0, 0, 0]) * TRUTH)
    alignment = agreed([*wrong, *alignments(1, 7)], 12)
    assert alignment is not None
    assert (alignment.located, alignment.agreeing, alignment.tried) == (10, 7, 12)
    xi = (TRUTH * alignment.T_old_new.inv()).as_exp_coords()
    assert lengths(xi[None], alignment.covariance[None])[0] < 3
    np.testing.assert_allclose(alignment.covariance, COVARIANCE)


def test_too_few_or_contradicting_alignments_are_refused() -> None:
    assert agreed([], 5) is None
    assert agreed(alignments(1, 1), 5) is None
    elsewhere = alignments(2, 3, RigidTransform.from_translation([30.0, 0, 0]) * TRUTH)
    assert agreed([*alignments(1, 3), *elsewhere], 8) is None


def test_one_alignment_is_enough_if_one_view_was_tried() -> None:
    assert agreed(alignments(1, 1), 1) is not None
