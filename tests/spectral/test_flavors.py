"""Equal registrations in both flavors of the kernels, and the time in a result."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import Device, choose_device
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.hemisphere import HemisphereConfig, HemisphereRegistrar
from sonarmap.spectral.registration import SpectralConfig, SpectralRegistrar
from sonarmap.spectral.result import Registration
from tests.samples.scenes.reliefs import HERE, THERE, above, relief, seen
from tests.samples.scenes.structures import assert_near, registered

FLAVORS = ("cpu", "gpu")
# step by step farther from the first: the last two share too little, or nothing
PLACES = [(THERE, 1), (above(-5, 6, 11, -60, -3, 5), 1), (above(14, 9, 12, 110), 1), (HERE, 2)]


def registrars(edge: int) -> dict[str, SpectralRegistrar]:
    own = choose_device().cl_device
    config, grid = SpectralConfig(max_tilt=float(np.deg2rad(30))), Grid(edge, 32 / edge)
    return {flavor: SpectralRegistrar(Device(own, flavor=flavor), grid, config) for flavor in FLAVORS}


@pytest.mark.parametrize(("edge", "places"), [(32, PLACES), (64, PLACES[:1])])
@pytest.mark.slow
def test_accepted_registrations_are_the_same(edge: int, places: list[tuple[RigidTransform, int]]) -> None:
    """Within 0.02 degrees and 0.02 voxels, a hundredth of what a registration is accurate to."""
    cases, accepted = registrars(edge), 0
    target = seen(relief(1), HERE)
    for place, scene in places:
        source = seen(relief(scene), place)
        mine, theirs = (registered(cases[flavor], target, source) for flavor in FLAVORS)
        assert mine.accepted == theirs.accepted
        assert mine.probability == pytest.approx(theirs.probability, abs=0.02)
        if not mine.accepted:
            continue
        accepted += 1
        assert_near(mine.T_target_source, theirs.T_target_source, 0.02, 0.02 * 32 / edge)
        assert mine.psr == pytest.approx(theirs.psr, rel=1e-3)
    assert accepted >= min(2, len(places))


@pytest.mark.slow
def test_the_papers_chain_finds_the_same_peaks() -> None:
    own = choose_device().cl_device
    target = seen(relief(1), HERE)
    source = target @ Rotation.from_euler("z", 20, degrees=True).as_matrix() + [1.5, -2.0, 0.5]
    results: list[Registration] = []
    for flavor in FLAVORS:
        registrar = HemisphereRegistrar(Device(own, flavor=flavor), Grid(64, 0.5), HemisphereConfig())
        results.append(registered(registrar, target, source))
    assert_near(results[0].T_target_source, results[1].T_target_source, 0.02, 0.01)
    assert results[0].psr == pytest.approx(results[1].psr, rel=1e-3)
