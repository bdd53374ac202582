"""Voxel noise: where it reaches, how many voxels flip, and the paper's D0 to D6."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.ndimage import distance_transform_cdt

from sonarmap.tools.lab.reproduce.structures import NOISES, envelope, swap

SHAPE = (23, 40, 31)


def generator(seed: int = 3) -> np.random.Generator:
    return np.random.default_rng(seed)


def scattered(share: float) -> np.ndarray:
    return generator(8).random(SHAPE) < share


@pytest.mark.parametrize("margin", [0, 1, 4, 7, 60])
def test_the_envelope_is_a_chessboard_distance(margin: int):
    occupied = scattered(0.0005)
    expected = np.asarray(distance_transform_cdt(~occupied, "chessboard")) <= margin
    assert_array_equal(envelope(occupied, margin), expected)


@pytest.mark.parametrize(
    ("name", "ratio", "margin"),
    [("D1", 100, 5), ("D2", 25, 5), ("D3", 100, 10), ("D4", 25, 10), ("D5", 100, None), ("D6", 25, None)],
)
def test_each_of_the_papers_noises_flips_its_share_of_its_region(name: str, ratio: int, margin: int | None):
    occupied = np.zeros((48, 64, 56), bool)
    occupied[20:24, 10:30, 40:43] = True
    low, high = np.array((20, 10, 40)), np.array((24, 30, 43))
    region = np.zeros_like(occupied)
    reach = 64 if margin is None else margin
    inside = zip(np.maximum(low - reach, 0), np.minimum(high + reach, occupied.shape), strict=True)
    region[tuple(slice(a, b) for a, b in inside)] = True
    flipped = swap(occupied, NOISES[name], generator()) ^ occupied
    assert flipped.sum() == round(region.sum() / ratio)
    assert not flipped[~region].any()
    assert margin is None or flipped[region & ~envelope(occupied, margin - 1)].any()
