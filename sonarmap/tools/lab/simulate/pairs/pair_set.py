"""Sets of pairs to judge a registration on: which pair n of a set is, the same whenever n and the seed are.

A set is without an end: its first 30 pairs of each scene meet every range of overlap with every noise and either turn
once, and so do the next 30. Any stretch of it is about as even.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.pairs.random_pairs import Turn, Turning, random_pair, unrelated_pair
from sonarmap.tools.lab.simulate.scenes.catalog import SCENE_KINDS
from sonarmap.tools.lab.simulate.sensing.noise import Noise

# The order decides what pair n is: a new scene is appended, and makes another set
SET_SCENES = ("floodgate", "pool", "bridge", "harbor", "manifold", "wreck", "clutter", "ship")
SET_OVERLAPS = ((0.05, 0.2), (0.2, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 1.0))
SET_SIGMA2 = (0.0, 1.0, 2.0)  # of the range at the sensor's maximum range in a scene of 256 m [m^2]
SET_TURNS: tuple[Turn, ...] = ("yaw", "any")
SET_TILT = math.radians(35.0)  # largest roll and pitch of the pairs with the turn "yaw"

OUTLIERS, DROPOUTS = 0.03, 0.2
GHOSTS, SPECKLE = 0.02, 1.0  # as in a simulated survey


@dataclass(frozen=True, slots=True)
class EvaluationPair:
    """One pair of a set, before it is simulated."""

    number: int  # which of the set
    scene: str  # a key of SCENE_KINDS
    overlaps: tuple[float, float]  # least and greatest share of the points in common, as random_pair takes them
    turn: Turn  # of the source's frame, as `Turning` has it
    noise: Noise  # its sigma2 is 0, 1 or 2 m^2 times the square of the scene's scale
    seed: int  # of the scene, the poses and the noise

    def scans(self) -> tuple[Scan, Scan, RigidTransform]:
        """Target Scan, source Scan and T_target_source between their frames."""
        return random_pair(self.seed, self.overlaps, self.noise, self.scene, turning=Turning(self.turn, SET_TILT))


@dataclass(frozen=True, slots=True)
class UnrelatedPair:
    """One pair of a set of scans that share nothing, before it is simulated."""

    number: int  # which of the set
    scene: str  # the target's; the source's is one of its `unrelated_scenes`, chosen by the seed
    noise: Noise  # as EvaluationPair's
    seed: int  # of the scenes, the poses and the noise

    def scans(self) -> tuple[Scan, Scan]:
        """Target Scan and source Scan; no transform is true between them."""
        return unrelated_pair(self.seed, self.noise, SET_TILT, self.scene)


def evaluation_pair(number: int, seed: int, turn: Turn | None = None) -> EvaluationPair:
    """Pair `number`, 0, 1, 2, ..., of the set `seed`; its turn, one of SET_TURNS in turns, may be given. Raises
    InputError: a negative number or seed."""
    scene = _of_scenes(number, seed)
    return EvaluationPair(
        number,
        scene,
        SET_OVERLAPS[number % len(SET_OVERLAPS)],
        # the other turn each time that the scenes have all been met
        SET_TURNS[(number + number // len(SET_SCENES)) % len(SET_TURNS)] if turn is None else turn,
        _noise(number, scene),
        _seed_of(number, seed, 1),
    )


def evaluation_unrelated(number: int, seed: int) -> UnrelatedPair:
    """Unrelated pair `number`, 0, 1, 2, ..., of the set `seed`. Raises InputError: a negative number or seed."""
    scene = _of_scenes(number, seed)
    return UnrelatedPair(number, scene, _noise(number, scene), _seed_of(number, seed, 2))


def _of_scenes(number: int, seed: int) -> str:
    if number < 0 or seed < 0:
        raise InputError(f"pair {number} of the set {seed}; wanted two numbers >= 0")
    return SET_SCENES[number % len(SET_SCENES)]


def _noise(number: int, scene: str) -> Noise:
    sigma2 = SET_SIGMA2[number // len(SET_SCENES) % len(SET_SIGMA2)] * SCENE_KINDS[scene].scale ** 2
    return Noise(sigma2, OUTLIERS, DROPOUTS, GHOSTS, SPECKLE)


def _seed_of(number: int, seed: int, what: int) -> int:
    """A seed of 32 bits: the pairs' scenes are ones that no test and no page has met."""
    return int(np.random.SeedSequence([seed, number, what]).generate_state(1)[0])
