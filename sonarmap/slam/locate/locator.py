"""The method that locates scans in a finished map, on one screen."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.slam.candidates.places import PlaceIndex
from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.live.tracker import WINDOW
from sonarmap.slam.locate.place import Located, Place, agreed_places, lies_at
from sonarmap.slam.locate.surveyed_map import SurveyedMap, View
from sonarmap.slam.motion.motion import Motion
from sonarmap.slam.pair import RegisteredPair
from sonarmap.spectral.expected import ExpectedPose
from sonarmap.spectral.prepare.spectral_scan import SpectralScan
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan

_MAX_KEYS = 8  # key scans tried per scan
_SUFFICIENT_PROBABILITY = 0.99  # at which, with enough keys, no further key scans are tried
_SUFFICIENT_KEYS = 3  # key scans that agree
_LIKELY = 0.5  # probability from which key scans near a place are tried
_ACCEPTED = 0.93  # probability from which a place is accepted; docs/measured has the evidence
_MIN_PROBABILITY = 0.01  # of a place that is kept
_PREPARED_KEYS = 32  # kept in memory
_ALLOWED_SIGMAS = 4.0  # of a measured position, within which key scans are tried


class Locator:
    def __init__(self, registrar: SpectralRegistrar, surveyed: SurveyedMap) -> None:
        """Index the signatures of the map's key scans; the registrar's grid must suit these.

        Raises:
            InputError: no key scan of the map can be registered.
        """
        self._registrar, self._map = registrar, surveyed
        self._floor = LoopSettings().floor(surveyed.voxel)
        self._key = lru_cache(_PREPARED_KEYS)(self._seen_from_key)
        keys = {key: registrar.signature(seen) for key in surveyed.apart if (seen := self._key(key)) is not None}
        if not keys:
            raise InputError("no key scan of the map can be registered, each shows too little; no scan can be located")
        self._keys, self._places = list(keys), PlaceIndex(np.array(list(keys.values())))

    def locate(self, scan: Scan, before: Sequence[Located] = ()) -> Located:
        """Locate a scan, by its points and its prior.

        It is searched near the pose that the motion of the scans located `before` predicts, then in the whole map. A
        scan that cannot be registered is not located; the result's reason says why.
        """
        start = perf_counter()
        try:
            prepared = self._registrar.prepare(scan)
            located = self._about(scan, prepared, before) or self._anywhere(scan, prepared)
        except InputError as error:
            located = Located(scan.name, scan.stamp, str(error))
        return replace(located, seconds=perf_counter() - start)

    def track(self, scans: Sequence[Scan], surveys: Sequence[int]) -> Iterator[Located]:
        """Locate consecutive scans, each with the motion of those before it; `surveys` are their survey numbers."""
        before: list[Located] = []
        for number, scan in enumerate(scans):
            follows = number > 0 and surveys[number] == surveys[number - 1] and scan.stamp > scans[number - 1].stamp
            located = self.locate(scan, before if follows else [])
            before = [*(before if follows else [])[1 - WINDOW :], located] if located.located else []
            yield located

    def _anywhere(self, scan: Scan, prepared: SpectralScan) -> Located:
        # 1. register to key scans until some agree: in turn the most similar one and the one nearest to the best place
        keys, answers, places = self._similar(scan, prepared), list[Place](), list[Place]()
        for turn in range(min(_MAX_KEYS, len(keys))):
            by_place = turn % 2 == 1 and places and places[0].probability >= _LIKELY
            key = keys[int(np.argmin(self._distances(places[0], keys))) if by_place else 0]
            keys.remove(key)
            answers += self._answers(key, prepared)
            places = agreed_places(answers, self._floor)
            if places and places[0].probability >= _SUFFICIENT_PROBABILITY and len(places[0].keys) >= _SUFFICIENT_KEYS:
                break
        # 2. check whether the most similar key scan out of its sight looks like the scan as well
        if places and places[0].probability >= _ACCEPTED:
            far = self._distances(places[0], keys) > View.of(scan.points).reach
            if far.any():
                places = agreed_places(answers + self._answers(keys[int(np.argmax(far))], prepared), self._floor)
        # 3. check the most probable place against the map seen from there
        places = [place for place in places if place.probability >= _MIN_PROBABILITY]
        if not places:
            return Located(scan.name, scan.stamp, "no key scan of the map resembles it")
        located = self._checked(scan, prepared, places[0])
        return replace(located, alternatives=tuple(places[1:]))

    def _distances(self, place: Place, keys: Sequence[int]) -> np.ndarray:
        """(k,) distances of key scans from a place [m]."""
        return np.linalg.norm(self._map.T_map_sensor.translation[list(keys)] - place.T_map_scan.translation, axis=1)

    def _similar(self, scan: Scan, prepared: SpectralScan) -> list[int]:
        """The key scans that a measured position allows, most similar first."""
        keys = [self._keys[n] for n in self._places.most_like(self._registrar.signature(prepared)).tolist()]
        prior = scan.prior
        if prior is None or not prior.knows_position or not self._map.measured[3:5].all():
            return keys
        apart = self._map.T_map_sensor.translation[keys] - prior.T_world_sensor.translation
        allowed = _ALLOWED_SIGMAS * prior.sigmas[3:5].max() + View.of(scan.points).reach
        return [key for key, shift in zip(keys, apart, strict=True) if np.linalg.norm(shift[:2]) <= allowed]

    def _seen(self, T_map_sensor: RigidTransform, view: View) -> SpectralScan | None:
        """The prepared scan of the map seen from a pose; None if it shows too little."""
        try:
            points = self._map.seen_from(T_map_sensor, view)
            return self._registrar.prepare(Scan(points, prior=self._map.prior_at(T_map_sensor), name="the map"))
        except InputError:
            return None

    def _seen_from_key(self, key: int) -> SpectralScan | None:
        return self._seen(self._map.T_map_sensor[key], self._map.view_of(key))

    def _answers(self, key: int, prepared: SpectralScan) -> list[Place]:
        """The places that a registration to a key scan and its alternatives give."""
        target, T_map_key = self._key(key), self._map.T_map_sensor[key]
        assert target is not None  # __init__ leaves out key scans that cannot be prepared
        first = self._registrar.register(target, prepared)
        return [
            Place(T_map_key * answer.T_target_source, answer.covariance, answer.probability, (key,), answer.fixed)
            for answer in (first, *first.alternatives)
            if answer.probability > 0
        ]

    def _checked(self, scan: Scan, prepared: SpectralScan, place: Place) -> Located:
        """The verdict on a place: registered without a bound to the map seen from there, the scan must return to it."""
        agreed = f"{len(place.keys)} of the map's key scans agree on the place (probability {place.probability:.1%})"
        if place.probability < _ACCEPTED:
            return Located(scan.name, scan.stamp, f"{agreed}, below the threshold", place)
        if (target := self._seen(place.T_map_scan, View.of(scan.points))) is None:
            return Located(scan.name, scan.stamp, f"{agreed}, but the map shows too little there", place)
        result = self._registrar.register(target, prepared)
        checked = self._in_map(place.T_map_scan, result)
        if lies_at(place, replace(checked, covariance=result.covariance), self._floor):
            checked = replace(checked, probability=place.probability * result.probability, keys=place.keys)
            return self._verdict(scan, checked, result, f"{agreed}; against the map seen from there: {result.reason}")
        doubted = replace(place, probability=place.probability * (1.0 - result.probability))
        return Located(scan.name, scan.stamp, f"{agreed}, but the map seen from there contradicts them", doubted)

    def _about(self, scan: Scan, prepared: SpectralScan, before: Sequence[Located]) -> Located | None:
        """The scan located near the pose that the motion predicts; None without a prediction or a success there."""
        steps = [_step(k, *pair) for k, pair in enumerate(pairwise(before))]
        stamps = np.array([*(each.stamp for each in before), scan.stamp], np.float64)
        motion = Motion.learn(steps, stamps, np.zeros(len(stamps), np.intp), self._floor) if steps else None
        if motion is None:
            return None
        expected = motion.expected(len(steps), len(before))
        T_map_scan = before[-1].T_map_scan * expected.T_target_source
        if (target := self._seen(T_map_scan, View.of(scan.points))) is None:
            return None
        about = ExpectedPose.of(RigidTransform.identity(), expected.covariance)
        result = self._registrar.register_expected(target, prepared, about)
        place = self._in_map(T_map_scan, result)
        located = self._verdict(scan, place, result, f"near the pose that the motion predicts: {result.reason}")
        return replace(located, tracked=True) if located.located and result.accepted else None

    def _in_map(self, T_map_view: RigidTransform, result: Registration) -> Place:
        """The place by a registration to the map's view, with the covariances of the registration and of the map."""
        T = T_map_view * result.T_target_source
        return Place(T, result.covariance + self._map.covariance_at(T), result.probability, (), result.fixed)

    @staticmethod
    def _verdict(scan: Scan, place: Place, result: Registration, reason: str) -> Located:
        located = place.probability >= _ACCEPTED and result.is_fixed
        return Located(scan.name, scan.stamp, reason, place, located, result.psr, result.overlap)


def _step(k: int, before: Located, after: Located) -> RegisteredPair:
    """The relative pose of consecutive located scans k and k + 1, as an accepted pair to learn the motion from."""
    T = before.T_map_scan.inv() * after.T_map_scan
    step = Registration(T, after.covariance, after.psr, after.overlap, accepted=True, seconds=0.0)
    return RegisteredPair(k, k + 1, "sequential", registration=step)
