"""Recall of signatures on a simulated survey whose lanes cross."""

from dataclasses import replace

import numpy as np
import pytest

from sonarmap.kernels.device.device import choose_device
from sonarmap.slam.candidates.places import PlaceIndex
from sonarmap.spectral.grid import choose_grid
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.tools.lab.reproduce.survey_rows import AMONG, GAP, recall
from sonarmap.tools.lab.reproduce.survey_rows import revisits as revisits_of
from sonarmap.tools.lab.simulate.plan import plan
from sonarmap.tools.lab.simulate.simulation import Simulation, simulate

EDGE, COUNT, SEED = 64, 120, 58


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
    return revisits_of(survey.scans, survey.truth.T_world_sensor, choose_grid(survey.scans, 128).voxel)


def at_random(rng: np.random.Generator) -> np.ndarray:
    """Scans (N, 10) drawn for each scan beyond the gap."""
    order = np.arange(COUNT)
    return np.array([rng.choice(order[np.abs(order - scan) > GAP], AMONG[-1], replace=False) for scan in order])


def test_recall_counts_the_scans_that_have_a_revisit():
    again = np.zeros((4, 4), bool)
    again[0, 3] = again[3, 0] = True
    index = np.full((4, 10), -1)
    index[0, :2] = 2, 3
    index[1, 0] = 3
    assert recall(index, again) == [0.0, 0.5, 0.5]
    assert np.isnan(recall(index, np.zeros((4, 4), bool))).all()


@pytest.mark.slow
def test_revisits_are_among_the_nearest_signatures(signatures, revisits):
    index, _ = PlaceIndex(signatures).nearest(AMONG[-1], GAP)
    draws = [at_random(np.random.default_rng(seed)) for seed in range(20)]
    chance = np.mean([recall(draw, revisits) for draw in draws], axis=0)
    found = recall(index, revisits)
    assert found[0] > 3 * chance[0]
    assert found[0] > 0.45
    assert found[2] > 0.8 > 1.3 * chance[2]
