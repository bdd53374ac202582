"""The same answers in both flavors of the kernels: of a processor, and of a graphics processor, forced on it."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import Device, choose_device
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.hemisphere.registration import HemisphereConfig, HemisphereRegistrar
from sonarmap.spectral.registration import SpectralConfig, SpectralRegistrar
from sonarmap.spectral.result import Registrar, Registration
from sonarmap.spectral.scan import Scan
from tests.samples.reliefs import above, relief, seen
from tests.samples.structures import difference

FLAVORS = ("cpu", "gpu")
HERE = above(0, 0, 12)
# step by step farther from the first: the last two share too little, or nothing
PLACES = [(above(3, -2, 13, 25, 4, -7), 1), (above(-5, 6, 11, -60, -3, 5), 1), (above(14, 9, 12, 110), 1), (HERE, 2)]


def registrars(edge: int) -> dict[str, SpectralRegistrar]:
    own = choose_device().cl_device
    config, grid = SpectralConfig(max_tilt=float(np.deg2rad(30))), Grid(edge, 32 / edge)
    return {flavor: SpectralRegistrar(Device(own, flavor=flavor), grid, config) for flavor in FLAVORS}


def register(registrar: Registrar, target: Scan, source: Scan) -> Registration:
    return registrar.register(registrar.prepare(target), registrar.prepare(source))


@pytest.mark.parametrize(("edge", "places"), [(32, PLACES), (64, PLACES[:1])])
def test_accepted_registrations_are_the_same(edge: int, places: list[tuple[RigidTransform, int]]) -> None:
    """Within 0.02 degrees and 0.02 voxels, a hundredth of what a registration is accurate to."""
    cases, accepted = registrars(edge), 0
    target = Scan(seen(relief(1), HERE))
    for place, scene in places:
        source = Scan(seen(relief(scene), place))
        mine, theirs = (register(cases[flavor], target, source) for flavor in FLAVORS)
        assert mine.accepted == theirs.accepted
        assert mine.probability == pytest.approx(theirs.probability, abs=0.02)
        if not mine.accepted:
            continue
        accepted += 1
        angle, distance = difference(mine.T_target_source, theirs.T_target_source)
        assert angle < 0.02
        assert distance < 0.02 * 32 / edge
        assert mine.psr == pytest.approx(theirs.psr, rel=1e-3)
    assert accepted >= min(2, len(places))


def test_the_papers_chain_finds_the_same_peaks() -> None:
    own = choose_device().cl_device
    target = Scan(seen(relief(1), HERE))
    turned = target.points @ Rotation.from_euler("z", 20, degrees=True).as_matrix() + [1.5, -2.0, 0.5]
    source = Scan(turned.astype(np.float32))
    results: list[Registration] = []
    for flavor in FLAVORS:
        registrar = HemisphereRegistrar(Device(own, flavor=flavor), Grid(64, 0.5), HemisphereConfig.paper())
        results.append(register(registrar, target, source))
    angle, distance = difference(results[0].T_target_source, results[1].T_target_source)
    assert angle < 0.02
    assert distance < 0.01
    assert results[0].psr == pytest.approx(results[1].psr, rel=1e-3)
