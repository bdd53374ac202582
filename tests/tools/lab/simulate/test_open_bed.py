"""Open beds: as flat or as weak as their names say, in their size and under the water."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sonarmap.tools.lab.simulate.scenes.bed import raster
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.shapes.solids import Mesh

COUNT = len(raster()) ** 2


def _heights(bed: Mesh) -> np.ndarray:
    """Of the bed without its rocks, above the plane that fits it best [m]."""
    ground = bed.vertices[:COUNT]
    level = np.column_stack([ground[:, :2], np.ones(COUNT)])
    return ground[:, 2] - level @ np.linalg.lstsq(level, ground[:, 2], rcond=None)[0]


@pytest.mark.parametrize("seed", [3, 4, 5])
@pytest.mark.parametrize(
    ("name", "least", "most"),
    [("flatbed", 0.08, 0.12), ("sandflat", 0.08, 0.12), ("seabed", 0.5, 2.0), ("shallow", 0.078, 0.32)],
)
def test_a_bed_has_the_relief_that_its_name_promises(name: str, seed: int, least: float, most: float):
    low, high = np.percentile(_heights(SCENE_KINDS[name].build(seed)), [2, 98])
    assert least < high - low < most


@pytest.mark.parametrize("name", ["flatbed", "sandflat", "seabed", "shallow"])
def test_a_bed_fills_its_box_under_the_places_of_the_sensors(name: str):
    kind = SCENE_KINDS[name]
    bed = kind.build(6).vertices[:COUNT]
    assert_allclose(np.ptp(bed, axis=0)[:2], kind.size)
    assert bed[:, 2].max() < 0
    inner = (np.abs(bed[:, :2]) < kind.highest[:2]).all(axis=1)
    assert (bed[inner, 2] < kind.highest[2] - 10 * kind.scale).all()


def test_the_small_bed_is_the_large_one_made_smaller():
    large, small = (SCENE_KINDS[name].build(7).vertices for name in ("seabed", "shallow"))
    assert_allclose(small, large * 40 / 256)
    assert len(large) > COUNT
