"""Shared parts of surfaces equal those by SciPy's tree, with random normals and weights."""

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.arrays import upload_poses
from sonarmap.kernels.device.device import Device
from sonarmap.kernels.surface.shared import Nearness, WeightedElements, shared_sums
from tests.kernels.surface.scenes import bent_sheet, random_rows, upload

WEIGHTS = np.array([0.3, 1.7, 0.9, 2.2, 0.6], np.float32)
NEARNESS = Nearness(reach=1.2, covered=5.0, alike=0.5)


def weighted(device: Device, rows: np.ndarray) -> WeightedElements:
    return WeightedElements(upload(device, rows), device.to_device(WEIGHTS))


def one_way(rows: np.ndarray, others: np.ndarray, R: np.ndarray, t: np.ndarray, most: int) -> np.ndarray:
    """(4,) sums over the points of `others`, which R and t move into the frame of `rows`."""
    few = others[:: max(1, -(-len(others) // most))]
    distance, index = KDTree(rows[:, :3]).query(few[:, :3] @ R.T + t)
    weights, on = WEIGHTS[few[:, 7].astype(int)], distance <= NEARNESS.reach
    facing = np.abs(np.einsum("ni,ni->n", few[:, 4:7] @ R.T, rows[index, 4:7]))
    agree = on & (facing >= NEARNESS.alike)
    return np.array([weights[agree].sum(), weights[distance <= NEARNESS.covered].sum(), weights.sum(), on.mean()])


@pytest.mark.parametrize(
    ("ours", "theirs", "poses", "most"), [(2000, 1500, 3, 10_000), (900, 2500, 72, 100), (65, 1, 1, 64)]
)
def test_equals_the_twin(device: Device, ours: int, theirs: int, poses: int, most: int) -> None:
    rng = np.random.default_rng(ours)
    target, source = (
        random_rows(bent_sheet(3 * count, seed)[:count], seed) for seed, count in enumerate((ours, theirs))
    )
    R, t = Rotation.from_rotvec(rng.normal(0, 0.2, (poses, 3))).as_matrix(), rng.normal(0, 2, (poses, 3))
    surfaces = weighted(device, target), weighted(device, source)
    got = shared_sums(device, *surfaces, upload_poses(device, R, t), most, NEARNESS).read()
    want = [
        [one_way(target, source, turn, shift, most), one_way(source, target, turn.T, -turn.T @ shift, most)]
        for turn, shift in zip(R, t, strict=True)
    ]
    np.testing.assert_allclose(got, want, rtol=1e-5, atol=1e-6)
