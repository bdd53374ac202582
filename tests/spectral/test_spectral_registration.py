"""The registration over all rotations: asymmetric scenes with truth, priors and bounds."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import choose_device
from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.prepare.spectral_scan import SpectralScan
from sonarmap.spectral.registration import SpectralConfig, SpectralRegistrar
from sonarmap.spectral.scan import PosePrior, Scan
from tests.samples.scenes import structures
from tests.samples.scenes.reliefs import HERE, T_TRUE, THERE, above, relief, seen
from tests.samples.scenes.structures import difference, moved
from tests.samples.scenes.structures import registered as register


def waves_with_boxes(rng: np.random.Generator) -> np.ndarray:
    """Points (60000, 3) [m] of a bed with five boxes and waves that nearly repeat after 13 to 15 m."""
    xy = rng.uniform(-45, 45, (60_000, 2))
    z = 0.6 * np.sin(xy[:, 0] / 5) * np.cos(xy[:, 1] / 7)
    for x, y, side, top in ((-12, 5, 6, 4), (8, -9, 4, 7), (15, 12, 8, 3), (-5, -18, 5, 5), (2, 16, 3, 6)):
        z[(abs(xy[:, 0] - x) < side / 2) & (abs(xy[:, 1] - y) < side / 2)] = top
    return np.column_stack([xy, z + rng.normal(0, 0.05, len(xy))])


EDGE, VOXEL = 64, 0.5
UNKNOWN = np.inf


@pytest.fixture(scope="module")
def registrar() -> SpectralRegistrar:
    return SpectralRegistrar(choose_device(), Grid(EDGE, VOXEL))


@pytest.fixture(scope="module")
def of_any_rotation() -> SpectralRegistrar:
    return SpectralRegistrar(choose_device(), Grid(32, 1.0), SpectralConfig(max_tilt=np.pi))


@pytest.fixture(scope="module")
def of_a_meter() -> SpectralRegistrar:
    return SpectralRegistrar(choose_device(), Grid(EDGE, 1.0), SpectralConfig())


@pytest.fixture(scope="module")
def target(registrar: SpectralRegistrar) -> SpectralScan:
    return registrar.prepare(Scan(seen(relief(1), HERE)))


@pytest.fixture(scope="module")
def source(registrar: SpectralRegistrar) -> SpectralScan:
    return registrar.prepare(Scan(seen(relief(1), THERE)))


# A tenth of a rotation's bin and a fifth of a voxel.
def assert_near(T: RigidTransform, truth: RigidTransform, degrees: float = 0.3, meters: float = 0.1) -> None:
    structures.assert_near(T, truth, degrees, meters)


class TestAccuracy:
    @pytest.mark.quick_cases(1)
    @pytest.mark.parametrize("rotvec", [(2.5, -1.0, 0.7), (0.0, 3.1, 0.0)])
    def test_any_rotation_is_found_without_a_bound_on_tilt(self, of_any_rotation, rotvec):
        Q = RigidTransform.from_components([2, -3, 1], Rotation.from_rotvec(rotvec))
        registration = register(of_any_rotation, seen(relief(2), HERE), moved(seen(relief(2), THERE), Q))
        assert_near(registration.T_target_source, T_TRUE * Q.inv(), 1.0, 0.25)

    @pytest.mark.slow
    def test_boxes_on_a_periodic_bed_determine_the_pose(self) -> None:
        """Waves of a bed lie upon one another as closely where they are laid one farther."""
        registrar = SpectralRegistrar(choose_device(), Grid(128, 0.5))
        there = above(6.1, 6.4, 12, 40)
        for seed in (3, 8):
            rng = np.random.default_rng(seed)
            target, source = (seen(waves_with_boxes(rng), place, 30.0) for place in (HERE, there))
            assert_near(register(registrar, target, source).T_target_source, HERE.inv() * there)


class TestViews:
    @pytest.mark.quick_cases(1)
    @pytest.mark.parametrize(("x", "y"), [(17.5, -1.0), (17.0, 17.5)])
    def test_a_shift_beyond_half_the_grid_is_distinguished_from_its_wrapped_twin(self, registrar, x, y):
        """The grid is 32 m wide: 17.5 m look like -14.5 m to a periodic correlation."""
        here, there = above(-x / 2, -y / 2, 12), above(x / 2, y / 2, 13, 15, 3, -5)
        registration = register(registrar, seen(relief(1), here, 15.0), seen(relief(1), there, 15.0))
        assert_near(registration.T_target_source, here.inv() * there)
        assert max(abs(x), abs(y)) > EDGE * VOXEL / 2

    def test_scans_without_a_single_viewpoint_register_by_their_points(self, registrar: SpectralRegistrar) -> None:
        """A ground and another 7 m above it: beams to the lower one would have to go through the upper."""
        both = np.vstack([relief(4), relief(54) + np.array([0, 0, 7.0])])
        here, there = above(0, 0, 14), above(3, -2, 15, 25, 4, -7)
        target, source = (registrar.prepare(Scan(seen(both, T))) for T in (here, there))
        assert target.view.ranges is None
        assert source.view.ranges is None
        registration = registrar.register(target, source)
        assert_near(registration.T_target_source, here.inv() * there)
        ground = registrar.prepare(Scan(seen(relief(4), there)))
        assert ground.view.ranges is not None
        assert_near(registrar.register(target, ground).T_target_source, here.inv() * there)

    @pytest.mark.quick_cases(1)
    @pytest.mark.parametrize("side", [-1, 1])
    def test_free_space_decides_between_twins(self, of_a_meter: SpectralRegistrar, side: int) -> None:
        """The target shows two equal sails, the source one of them, seen through the place of the other.

        From its sensor, which stands off to one side, the nearer sail would have hidden the farther.
        """
        twins = {-1: np.array([-9.0, 1, 0]), 1: np.array([9.0, 1, 0])}
        here, there = above(0, -45, 3), above(side * 40, 1, 0)
        place = np.vstack([sail(1) + twins[-1], sail(1) + twins[1]])
        source = there.inv().apply(sail(2) + twins[side]).astype(np.float32)
        registration = register(of_a_meter, here.inv().apply(place).astype(np.float32), source)
        assert_near(registration.T_target_source, here.inv() * there, 2.0, 1.0)
        assert registration.overlap == pytest.approx(0.5, abs=0.03)
        # the other pose fits the points equally well; only the views make it improbable
        assert registration.probability > 0.5
        assert all(alternative.probability < 0.2 for alternative in registration.alternatives)


def sail(seed: int) -> np.ndarray:
    """Points (6000, 3) of a twisted strip, 12 m high, no part of which hides another from the side or the front."""
    z, along = np.random.default_rng(seed).uniform([-6, -3], [6, 3], (6000, 2)).T
    return np.column_stack([3 * np.sin(0.5 * z) + along, 2 * np.cos(0.9 * z + 1) + along + 0.15 * along**2, z])


class TestPriors:
    """Attitude, heading, depth and position of both scans, and one of them wrong."""

    @staticmethod
    def with_prior(
        scan: SpectralScan, T: RigidTransform, heading: float = 2.0, depth: float = UNKNOWN, xy: float = UNKNOWN
    ) -> SpectralScan:
        """The prepared scan with a prior: attitude within a degree, and the other sigmas as given [deg, m]."""
        return replace(scan, prior=PosePrior(T, np.array([*np.deg2rad([1.0, 1.0, heading]), xy, xy, depth])))

    def test_true_priors_do_not_change_the_pose(self, registrar, target, source):
        plain = registrar.register(target, source)
        known = (self.with_prior(scan, T, depth=0.1, xy=0.5) for scan, T in ((target, HERE), (source, THERE)))
        registration = registrar.register(*known)
        assert_near(registration.T_target_source, plain.T_target_source, 0.01, 0.01)
        assert registration.accepted

    @pytest.mark.slow
    def test_the_heading_resolves_a_symmetric_place(self, registrar: SpectralRegistrar) -> None:
        """A ground of twofold symmetry has two poses, of which the heading allows one."""
        half = relief(3)[relief(3)[:, 0] > 0]
        ground = np.vstack([half, half * np.array([-1, -1, 1])])
        target = registrar.prepare(Scan(seen(ground, HERE)))
        right = 0
        for yaw in (20.0, -160.0):
            there = above(0, 0, 12.5, yaw)
            source = registrar.prepare(Scan(seen(ground, there)))
            registration = registrar.register(self.with_prior(target, HERE, 5.0), self.with_prior(source, there, 5.0))
            assert_near(registration.T_target_source, HERE.inv() * there)
            alone = registrar.register(target, source)
            right += difference(alone.T_target_source, HERE.inv() * there)[0] < 1.0
        assert right == 1

    @pytest.mark.quick_cases(1)
    @pytest.mark.parametrize(
        ("wrong", "bounds"),
        [
            (above(3, -2, 13, 25, 40, -7), {"heading": UNKNOWN}),
            (above(3, -2, 30, 25, 4, -7), {"depth": 0.1}),
            (above(20, 20, 13, 25, 4, -7), {"depth": 0.1, "xy": 0.5}),
        ],
        ids=["attitude", "depth", "position"],
    )
    def test_scans_that_contradict_a_prior_are_refused(
        self, registrar, target, source, wrong: RigidTransform, bounds: dict[str, float]
    ) -> None:
        pair = self.with_prior(target, HERE, **bounds), self.with_prior(source, wrong, **bounds)
        registration = registrar.register(*pair)
        assert not registration.accepted
        assert registration.probability < 0.1

    def test_scans_of_two_places_are_refused(self, registrar: SpectralRegistrar, target: SpectralScan) -> None:
        other = registrar.register(target, registrar.prepare(Scan(seen(relief(2), THERE))))
        assert not other.accepted
        assert other.probability < 0.5


class TestBounds:
    @pytest.mark.quick_cases(1)
    @pytest.mark.parametrize(("bound", "within"), [(5.0, False), (20.0, True)])
    def test_max_tilt_bounds_the_pose(self, bound: float, within: bool) -> None:
        rolled = above(3, -2, 13, 25, 4, 15)
        config = SpectralConfig(max_tilt=float(np.deg2rad(bound)))
        registrar = SpectralRegistrar(choose_device(), Grid(EDGE, VOXEL), config)
        answer = register(registrar, seen(relief(1), HERE), seen(relief(1), rolled))
        assert (difference(answer.T_target_source, HERE.inv() * rolled)[0] < 0.3) == within
        if not within:
            assert not answer.accepted

    @pytest.mark.parametrize(
        ("changes", "words"),
        [
            ({"hypotheses": 0}, "`hypotheses=0`"),
            ({"max_tilt": 3.2}, "`max_tilt` is 183"),
            ({"least_probability": 1.0}, r"`least_probability=1\.0`"),
        ],
    )
    def test_config_refuses_what_makes_no_sense(self, changes: dict, words: str) -> None:
        with pytest.raises(InputError, match=words):
            SpectralConfig(**changes)
