"""Refinement over weak relief, whose normals are mostly noise, converges to the truth."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonarmap.spectral.prepare.surface import Surface, smoothed_further
from sonarmap.spectral.verify.hypothesis_testing import _CLOSE, _FINAL, _SMOOTHED
from sonarmap.spectral.verify.icp import Stage, Start, refine
from tests.spectral.surfaces import chosen_device, surface_of


def bed(seed: int) -> np.ndarray:
    """(n, 3) of dunes 20 and 27 voxels long, scattered anew by each seed, with noise [voxels]."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-30, 30, (2, 3600))
    z = 0.4 * np.sin(2 * np.pi * x / 27) * np.cos(2 * np.pi * y / 20)
    return np.column_stack([x, y, z + rng.normal(0, 0.4, x.size)])


AWAY = np.array([2.0, -1.0, 0.0])  # voxels


def left_over(surfaces: list[tuple[Surface, Surface]], stages: Sequence[Stage]) -> float:
    """Error of a refinement whose stages use different surfaces [voxels]."""
    shift = AWAY
    for (target, source), stage in zip(surfaces, stages, strict=True):
        start = Start(Rotation.concatenate([Rotation.identity()]), shift[None], np.zeros(1))
        shift = refine(chosen_device(), target, source, start, [stage]).read()[0].shift
    return float(np.linalg.norm(shift))


@pytest.mark.slow
def test_further_smoothing_makes_the_refinement_converge() -> None:
    ends: list[tuple[float, float]] = []
    for seed in (1, 11, 21):
        target, source = surface_of(bed(seed)), surface_of(bed(seed + 1))
        smoother = list(zip(*(smoothed_further(chosen_device(), each) for each in (target, source)), strict=True))
        ends.append(
            (left_over(smoother, [_SMOOTHED] * len(smoother)), left_over([(target, source)] * 2, (_CLOSE, _FINAL)))
        )
    smoothed, as_they_are = np.mean(ends, axis=0)
    assert smoothed < 0.45
    assert as_they_are > 0.7
