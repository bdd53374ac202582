"""What a pair's number, seed and kind decide: its scene, its poses, its noise, each from a generator of its own."""

from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np

from sonarmap.tools.lab.simulate.kinds.catalog import scan_kind
from sonarmap.tools.lab.simulate.kinds.reliefs import relief_of
from sonarmap.tools.lab.simulate.pairs.pair_set import DROPOUTS, GHOSTS, OUTLIERS, SPECKLE
from sonarmap.tools.lab.simulate.pairs.viewpoints import Observer
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.sensing.noise import Noise
from sonarmap.tools.lab.simulate.sensing.sensors import SENSORS, bare

SIGMA2 = (0.25, 1.0, 4.0)  # of the range at the sensor's maximum range in a scene of 256 m [m^2], in turns
# On an open bed noise as large as its relief would leave nothing to register: a quarter of the standard deviation
OPEN_BED = 1 / 16
# By how much a level fan is mounted nose down over an open bed, of which it would see little else [rad]
MOUNTED = np.deg2rad(30.0)
OPEN = ("sandflat", "shallow", "rubble")


@dataclass(frozen=True, slots=True)
class PairDraws:
    """Of one pair.

    Attributes:
        scene: the seed of the scene.
        poses: draws both poses.
        distortion: draws how the scans are distorted.
        target, source: draw the noise of either scan.
    """

    scene: int
    poses: np.random.Generator
    distortion: np.random.Generator
    target: np.random.Generator
    source: np.random.Generator


def pair_draws(kind: str, number: int, seed: int) -> PairDraws:
    """The generators of pair `number` of the set `seed` of one kind; no two kinds share them."""
    sequence = np.random.SeedSequence([seed, number, crc32(kind.encode())])
    scene = int(sequence.generate_state(1)[0])
    return PairDraws(scene, *(np.random.default_rng(child) for child in sequence.spawn(4)))


def noise_of(kind: str, number: int, scene: str) -> Noise:
    """The noise of pair `number`: every scene meets every overlap with every variance within nine of its turns."""
    turn = number // len(scan_kind(kind).scenes)
    sigma2 = SIGMA2[(number + turn + turn // len(SIGMA2)) % len(SIGMA2)] * SCENE_KINDS[scene].scale ** 2
    if relief_of(scene) in ("flat", "weak"):
        sigma2 *= OPEN_BED
    return Noise(sigma2, OUTLIERS, DROPOUTS, GHOSTS, SPECKLE)


def observer_of(scene: str, seed: int) -> Observer:
    """The bare fan of the sensor that suits the scene, mounted nose down where it would see little else of it."""
    world = build_scene(scene, seed)
    sensor = bare(SENSORS[world.kind.sensor])
    return Observer(world, replace(sensor, tilt=float(MOUNTED)) if scene in OPEN else sensor)
