"""Placement of scans as they arrive: by registration to the last key scan, or, if that fails, as the start of a new
part of the map."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.motion.limits import NO_LIMITS, MotionLimits
from sonarmap.slam.motion.motion import Motion
from sonarmap.slam.motion.reconsider import is_doubtful, with_both, with_motion, without_unreachable
from sonarmap.slam.pair import Candidate, RegisteredPair
from sonarmap.slam.stream.keys import AIM, KeySettings, key_share
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan

Register = Callable[[Scan, Scan, Candidate], RegisteredPair]

LOST = 3  # consecutive scans that cannot be placed, after which the vehicle is lost
WINDOW = 12  # last key scans, or located scans, from which the motion is learned
# A step that is unusual, or follows a scan that could not be placed, may be a jump to a place that looks the same.
_UNUSUAL_SIGMAS = 1.8  # from the usual motion
_JUMP_PROBABILITY = 0.97  # from which such a step is accepted


@dataclass(frozen=True, slots=True)
class Placed:
    """Where a scan lies."""

    key: int  # number of the key scan that T_key_sensor refers to
    T_key_sensor: RigidTransform
    covariance: np.ndarray  # (6, 6) of the registration, rotation first [rad, m], body tangent; 0 for a key scan


@dataclass(slots=True)
class Tracker:
    """Places scans one by one.

    Attributes:
        register: registers a source to a target; the candidate has the pair's numbers and its expected pose.
        looks_again: whether `register` can use an expected pose.
        voxel: edge of the survey's voxels [m].
        floor: (6,) standard deviations added to those of expected poses [rad, m].
        limits: largest speed, turn rate and step of the vehicle.
        settings: distance between key scans.
        keys: the key scans so far.
        starts: numbers of the key scans that begin a part, ascending.
        steps: registrations of the other key scans to the one before, by number.
        missed: number of consecutive scans that could not be placed.
        anew: whether the next scan begins a part, because its pose relative to the last key scan is unknown.
    """

    register: Register
    looks_again: bool
    voxel: float
    floor: np.ndarray
    limits: MotionLimits = NO_LIMITS
    settings: KeySettings = field(default_factory=KeySettings)
    keys: list[Scan] = field(default_factory=list[Scan])
    starts: list[int] = field(default_factory=list[int])
    steps: dict[int, RegisteredPair] = field(default_factory=dict[int, RegisteredPair])
    missed: int = 0
    anew: bool = False
    _before: tuple[Scan, RegisteredPair] | None = None  # the previous scan, if it was placed and is no key scan
    _waiting: Scan | None = None  # the last scan that could not be placed

    @property
    def is_lost(self) -> bool:
        """Whether the last `LOST` scans or more could not be placed."""
        return self.missed >= LOST

    def add(self, scan: Scan, last_chance: bool = True) -> Placed | None:
        """Place the next scan; None if it cannot be placed.

        Without `last_chance`, a failure changes nothing: the caller will try a scan nearer to the last one placed.
        """
        if not self.keys or self.anew:
            return self._begin_part(scan)
        if (placed := self._by_last_key(scan)) is not None:
            return placed
        if not last_chance:
            return None
        self.missed += 1
        if (waiting := self._waiting) is not None:
            number = len(self.keys)
            pair = self.register(waiting, scan, Candidate(number, number + 1, "sequential"))
            if pair.accepted:
                self._begin_part(waiting)
                return self._place(scan, pair)
        self._waiting = scan
        return None

    def restore(self, scan: Scan, step: Registration | None) -> None:
        """Add a key scan of an earlier run with its registration to the one before; None for the first of a part."""
        number = len(self.keys)
        if step is None:
            self._begin_part(scan)
        else:
            self._add_key(scan, RegisteredPair(number - 1, number, "sequential", registration=step))

    def _by_last_key(self, scan: Scan) -> Placed | None:
        """Place a scan by the last key scan; if that fails, make the previous scan a key scan and place it by that."""
        pair = self._step(self.keys, self.steps, scan)
        if not pair.accepted and self._before is not None:
            before, of_before = self._before
            number = len(self.keys)
            pair = self._step([*self.keys, before], {**self.steps, number: of_before}, scan)
            if pair.accepted:
                self._add_key(before, of_before)
        return self._place(scan, pair) if pair.accepted else None

    def _place(self, scan: Scan, pair: RegisteredPair) -> Placed:
        registration = pair.registration
        assert registration is not None
        self.missed, self._waiting = 0, None
        if key_share(registration, self.voxel, self.settings) >= AIM:
            self._add_key(scan, pair)
            return Placed(pair.j, RigidTransform.identity(), np.zeros((6, 6)))
        self._before = scan, pair
        return Placed(pair.i, registration.T_target_source, registration.covariance)

    def _add_key(self, scan: Scan, step: RegisteredPair) -> None:
        self.steps[len(self.keys)] = replace(step, i=len(self.keys) - 1, j=len(self.keys))
        self.keys.append(scan)
        self._before = None

    def _begin_part(self, scan: Scan) -> Placed:
        self.starts.append(len(self.keys))
        self.keys.append(scan)
        self._before, self._waiting, self.anew = None, None, False
        return Placed(len(self.keys) - 1, RigidTransform.identity(), np.zeros((6, 6)))

    def _step(self, keys: Sequence[Scan], steps: dict[int, RegisteredPair], scan: Scan) -> RegisteredPair:
        """The scan's registration to the last of these key scans; a doubtful one is repeated where the usual motion
        expects it, and an implausible one is refused."""
        last = len(keys) - 1
        step = Candidate(last, last + 1, "sequential")
        pair = self.register(keys[last], scan, step)
        motion = self._motion(keys, steps, scan)
        if motion is None or pair.registration is None:
            return pair
        number = {k: k - last - 2 + len(motion.times) for k in step.scans}
        back = {n: k for k, n in number.items()}
        pair = pair.renumbered(number)
        if self.looks_again and is_doubtful(pair, motion):
            again = self.register(keys[last], scan, replace(step, expected=motion.expected(*pair.scans)))
            pair = with_both(pair, again.renumbered(number), motion)
        (pair,) = with_motion([without_unreachable(pair, motion)], motion)
        registration = pair.registration
        if registration is not None and registration.accepted and not self._is_credible(pair, registration, motion):
            pair = replace(pair, registration=replace(registration, accepted=False))
        return pair.renumbered(back)

    def _motion(self, keys: Sequence[Scan], steps: dict[int, RegisteredPair], scan: Scan) -> Motion | None:
        """The vehicle's usual motion, learned from the last key scans."""
        first = max(0, len(keys) - WINDOW)
        recent = [steps[k] for k in range(first + 1, len(keys)) if k in steps]
        pairs = [pair.renumbered({k: k - first for k in pair.scans}) for pair in recent]
        stamps = np.array([each.stamp for each in (*keys[first:], scan)], dtype=np.float64)
        return Motion.learn(pairs, stamps, np.zeros(len(stamps), np.intp), self.floor, self.limits)

    def _is_credible(self, pair: RegisteredPair, registration: Registration, motion: Motion) -> bool:
        """Whether a step agrees with the usual motion, or is probable enough without it."""
        T = registration.T_target_source
        if motion.contradicts(*pair.scans, T):
            return False
        is_usual = not self.missed and motion.expected(*pair.scans).distance(T) < _UNUSUAL_SIGMAS
        return bool(is_usual or not registration.probability < _JUMP_PROBABILITY)  # NaN of methods that do not say
