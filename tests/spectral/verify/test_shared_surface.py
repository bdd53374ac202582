"""Surfaces that two scans share."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.arrays import upload_poses
from sonarmap.spectral.prepare.surface import Surface
from sonarmap.spectral.verify.verifier import SharedSurface, shared_surfaces
from tests.spectral.surfaces import chosen_device, surface_of

R, SHIFT = Rotation.from_euler("ZYX", [20, -6, 9], degrees=True), np.array([7.0, -3.5, 1.25])
STILL, HERE = Rotation.identity(), np.zeros(3)
ALL = 100_000


def bed(half: int = 30) -> np.ndarray:
    """One point per voxel, level at z = 0."""
    x, y = np.meshgrid(np.arange(-half, half), np.arange(-half, half))
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]).astype(float)


def wall(x: float) -> np.ndarray:
    """Points of a wall across x, above the bed."""
    y, z = np.meshgrid(np.arange(-20, 20), np.arange(3, 13))
    return np.column_stack([np.full(y.size, x), y.ravel(), z.ravel()])


def moved(points: np.ndarray, x: float, y: float, z: float) -> np.ndarray:
    return points + np.array([x, y, z])


def shared_surface(target: Surface, source: Surface, R: Rotation, shift: np.ndarray, most: int) -> SharedSurface:
    """The shared surface under one pose."""
    poses = upload_poses(chosen_device(), R.as_matrix()[None], shift[None])
    return shared_surfaces(chosen_device(), target, source, poses, most).read()


def shares(target: np.ndarray, source: np.ndarray, R: Rotation = STILL, shift: np.ndarray = HERE) -> tuple[float, ...]:
    found = shared_surface(surface_of(target), surface_of(source), R, shift, ALL)
    return found.agree.item(), found.covered.item(), found.overlap.item()


def test_a_scan_shares_its_whole_surface_with_itself_in_any_orientation() -> None:
    scene = np.vstack([bed(), wall(10.0)])
    assert shares(scene, R.inv().apply(scene - SHIFT), R, SHIFT) == pytest.approx((1, 1, 1), abs=0.01)


def test_a_surface_that_crosses_another_does_not_agree_with_it() -> None:
    """A ramp through the bed, 60 degrees steep: some of its points lie near the bed's, none faces up."""
    ramp = Rotation.from_euler("x", 60, degrees=True).apply(bed(6))
    agree, _, overlap = shares(bed(), ramp)
    assert agree < 0.02
    assert overlap > 0.01


def test_uncovered_points_do_not_lower_the_consistency() -> None:
    """Half of the source is beyond the target's edge: only the rest counts."""
    found = shared_surface(surface_of(bed()), surface_of(moved(bed(), 30.0, 0, 0)), STILL, HERE, ALL)
    assert found.overlap == pytest.approx(0.5, abs=0.06)
    assert found.consistency > 0.75
    above = shared_surface(surface_of(bed()), surface_of(moved(bed(), 0, 0, 4.0)), STILL, HERE, ALL)
    assert above.covered > 0.9
    assert above.consistency == 0
    # nothing in common is nothing
    assert shares(bed(), moved(bed(), 0, 0, 500.0)) == (0, 0, 0)


def test_a_wall_has_the_weight_of_the_wide_bed() -> None:
    """The walls are 8 voxels apart: nine points of ten, on the beds, agree, but only half of the directions."""
    agree, covered, overlap = shares(np.vstack([bed(), wall(10.0)]), np.vstack([bed(), wall(18.0)]))
    assert overlap > 0.88
    assert 0.4 < agree < 0.65
    assert covered > agree
