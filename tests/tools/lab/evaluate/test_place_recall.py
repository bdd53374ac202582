"""Recall of signatures on a simulated survey whose lanes cross."""

from dataclasses import replace

import numpy as np
import pytest

from sonarmap.kernels.device.device import choose_device
from sonarmap.slam.candidates.places import PlaceIndex
from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.map.cell import outline, overlapping
from sonarmap.spectral.grid import choose_grid
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.tools.lab.simulate.plan import plan
from sonarmap.tools.lab.simulate.simulation import Simulation, simulate

EDGE, COUNT, SEED = 64, 120, 58
OVERLAP = 0.4  # smallest overlap of a scan with its revisit at the true poses
GAP = 5  # the indices of a scan and its revisit differ by more than this
AMONG = (1, 5, 10)  # numbers of candidates for which recall is computed


@pytest.fixture(scope="module")
def survey() -> Simulation:
    return simulate(replace(plan("bridge", "lawnmower", None, SEED), count=COUNT))


@pytest.fixture(scope="module")
def signatures(survey) -> np.ndarray:
    registrar = SpectralRegistrar(choose_device(), choose_grid(survey.scans, EDGE))
    return np.array([registrar.signature(registrar.prepare(scan)) for scan in survey.scans])


@pytest.fixture(scope="module")
def revisits(survey) -> np.ndarray:
    """Whether two scans see the same place again (N, N) bool."""
    cell = LoopSettings().cell_voxels * choose_grid(survey.scans, 128).voxel
    outlines = [outline(scan, cell) for scan in survey.scans]
    pairs, _ = overlapping(outlines, survey.truth.T_world_sensor, cell, OVERLAP)
    i, j = pairs[pairs[:, 1] - pairs[:, 0] > GAP].T
    again = np.zeros((COUNT, COUNT), bool)
    again[i, j] = again[j, i] = True
    return again


def recall(index: np.ndarray, again: np.ndarray) -> list[float]:
    """Share of the scans with a revisit that have one among their first 1, 5, 10 candidates, `index` (N, 10)."""
    right = (np.take_along_axis(again, index, axis=1))[again.any(axis=1)]
    return [float(right[:, :k].any(axis=1).mean()) for k in AMONG]


def at_random(rng: np.random.Generator) -> np.ndarray:
    """Scans (N, 10) drawn for each scan beyond the gap."""
    order = np.arange(COUNT)
    return np.array([rng.choice(order[np.abs(order - scan) > GAP], AMONG[-1], replace=False) for scan in order])


@pytest.mark.slow
def test_revisits_are_among_the_nearest_signatures(signatures, revisits):
    order = np.arange(COUNT)
    distances = PlaceIndex(signatures).distances(order, order)
    distances[np.abs(order[:, None] - order) <= GAP] = np.inf
    index = np.argsort(distances, axis=1)[:, : AMONG[-1]]
    draws = [at_random(np.random.default_rng(seed)) for seed in range(20)]
    chance = np.mean([recall(draw, revisits) for draw in draws], axis=0)
    found = recall(index, revisits)
    assert found[0] > 3 * chance[0]
    assert found[0] > 0.45
    assert found[2] > 0.8 > 1.3 * chance[2]
