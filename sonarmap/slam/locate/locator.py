"""Finding where scans were taken in a finished map; on one screen."""

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
from sonarmap.slam.locate.place import Located, Place, agreed_places, lies_at
from sonarmap.slam.locate.surveyed_map import SurveyedMap, View
from sonarmap.slam.motion.motion import Motion
from sonarmap.slam.pair import RegisteredPair
from sonarmap.spectral.expected import ExpectedPose
from sonarmap.spectral.prepare.spectral_scan import SpectralScan
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan

_MOST_TRIED = 8  # key scans
_SUFFICIENT_PROBABILITY = 0.99  # no more key scans are tried from here on, if the place has
_SUFFICIENT_KEYS = 3  # key scans that agree
_LIKELY = 0.5  # probability from which key scans near a place are tried
_ELSEWHERE = 1  # key scans from which the place cannot be seen, the most similar first, that are tried then
_ACCEPTED = 0.93  # probability from which a place is accepted; docs/measured has the evidence
_LEAST_PROBABILITY = 0.01  # of a place that is kept
_PREPARED_KEYS = 32  # that are kept
_WINDOW = 12  # scans from which the motion is learned
_ALLOWED_SIGMAS = 4.0  # of a measured position, within which key scans are tried


class Locator:
    def __init__(self, registrar: SpectralRegistrar, surveyed: SurveyedMap) -> None:
        """Prepare the map's key scans once, on the registrar's grid, which suits them.

        Raises:
            InputError: nothing of the map can be registered.
        """
        self._registrar, self._map = registrar, surveyed
        self._floor = LoopSettings().floor(surveyed.voxel)
        self._key = lru_cache(_PREPARED_KEYS)(self._seen_from_key)
        keys = {key: registrar.signature(it) for key in surveyed.apart if (it := self._key(key)) is not None}
        if not keys:
            raise InputError("no scan has enough points of its own in the map; nothing to find a place by")
        self._keys, self._places = list(keys), PlaceIndex(np.array(list(keys.values())))

    def locate(self, scan: Scan, before: Sequence[Located] = ()) -> Located:
        """Where a scan was taken, by the scan and what instruments measured of it.

        Where the motion of scans that were located `before` it expects it, and in the whole map where it is not found
        there. One that cannot be registered at all is not located, and the reason says why.
        """
        start = perf_counter()
        try:
            prepared = self._registrar.prepare(scan)
            located = self._about(scan, prepared, before) or self._anywhere(scan, prepared)
        except InputError as error:
            located = Located(scan.name, scan.stamp, str(error))
        return replace(located, seconds=perf_counter() - start)

    def track(self, scans: Sequence[Scan], surveys: Sequence[int]) -> Iterator[Located]:
        """Where scans were taken of which those of one survey (the number of each scan's) follow one another."""
        before: list[Located] = []
        for number, scan in enumerate(scans):
            follows = number > 0 and surveys[number] == surveys[number - 1] and scan.stamp > scans[number - 1].stamp
            located = self.locate(scan, before if follows else [])
            before = [*(before if follows else [])[1 - _WINDOW :], located] if located.located else []
            yield located

    def _anywhere(self, scan: Scan, prepared: SpectralScan) -> Located:
        # 1. poses by registration to key scans, the most similar and the nearest to a place in turn, until some agree
        keys, answers, places = self._alike(scan, prepared), list[Place](), list[Place]()
        for turn in range(min(_MOST_TRIED, len(keys))):
            by_place = turn % 2 == 1 and places and places[0].probability >= _LIKELY
            key = keys[int(np.argmin(self._apart_from(places[0], keys))) if by_place else 0]
            keys.remove(key)
            answers += self._answers(key, prepared)
            places = agreed_places(answers, self._floor)
            if places and places[0].probability >= _SUFFICIENT_PROBABILITY and len(places[0].keys) >= _SUFFICIENT_KEYS:
                break
        # 2. whether it looks like another place as well, from which this one cannot be seen
        if places and places[0].probability >= _ACCEPTED:
            far = self._apart_from(places[0], keys) > View.of(scan.points).reach
            elsewhere = [key for key, is_far in zip(keys, far, strict=True) if is_far]
            answers += [answer for key in elsewhere[:_ELSEWHERE] for answer in self._answers(key, prepared)]
            places = agreed_places(answers, self._floor)
        # 3. the most probable place, checked against all that the map shows from there
        places = [place for place in places if place.probability >= _LEAST_PROBABILITY]
        if not places:
            return Located(scan.name, scan.stamp, "no key scan of the map is like it")
        located = self._checked(scan, prepared, places[0])
        return replace(located, alternatives=tuple(places[1:]))

    def _apart_from(self, place: Place, keys: Sequence[int]) -> np.ndarray:
        """(k,) how far key scans lie from a place [m]."""
        return np.linalg.norm(self._map.T_map_sensor.translation[list(keys)] - place.T_map_scan.translation, axis=1)

    def _alike(self, scan: Scan, prepared: SpectralScan) -> list[int]:
        """The key scans, most similar first, that lie where instruments allow it."""
        keys = [self._keys[n] for n in self._places.most_like(self._registrar.signature(prepared)).tolist()]
        prior = scan.prior
        if prior is None or not prior.knows_position or not self._map.measured[3:5].all():
            return keys
        apart = self._map.T_map_sensor.translation[keys] - prior.T_world_sensor.translation
        allowed = _ALLOWED_SIGMAS * prior.sigmas[3:5].max() + View.of(scan.points).reach
        return [key for key, shift in zip(keys, apart, strict=True) if np.linalg.norm(shift[:2]) <= allowed]

    def _seen(self, T_map_sensor: RigidTransform, view: View) -> SpectralScan | None:
        """The map as it is seen from a pose, prepared; None where it shows too little."""
        try:
            points = self._map.seen_from(T_map_sensor, view)
            return self._registrar.prepare(Scan(points, prior=self._map.prior_at(T_map_sensor), name="the map"))
        except InputError:
            return None

    def _seen_from_key(self, key: int) -> SpectralScan | None:
        return self._seen(self._map.T_map_sensor[key], self._map.view_of(key))

    def _answers(self, key: int, prepared: SpectralScan) -> list[Place]:
        """What a registration to a key scan says of the place, and its alternatives."""
        target, T_map_key = self._key(key), self._map.T_map_sensor[key]
        assert target is not None  # as key scans that cannot be prepared are none
        first = self._registrar.register(target, prepared)
        return [
            Place(T_map_key * answer.T_target_source, answer.covariance, answer.probability, (key,), answer.fixed)
            for answer in (first, *first.alternatives)
            if answer.probability > 0
        ]

    def _checked(self, scan: Scan, prepared: SpectralScan, place: Place) -> Located:
        """A place with the registration to the map as it is seen from there, anywhere in it: that has to lead back."""
        agreed = f"of the map's key scans {len(place.keys)} name the place (probability {place.probability:.1%})"
        if place.probability < _ACCEPTED:
            return Located(scan.name, scan.stamp, f"{agreed}, below the threshold", place)
        if (target := self._seen(place.T_map_scan, View.of(scan.points))) is None:
            return Located(scan.name, scan.stamp, f"{agreed}, but the map shows too little there", place)
        found = self._registrar.register(target, prepared)
        known = self._in_map(place.T_map_scan, found)
        if lies_at(place, replace(known, covariance=found.covariance), self._floor):
            known = replace(known, probability=place.probability * found.probability, keys=place.keys)
            return self._verdict(scan, known, found, f"{agreed}; against the map as it is seen there: {found.reason}")
        left = replace(place, probability=place.probability * (1.0 - found.probability))
        return Located(scan.name, scan.stamp, f"{agreed}, but the map as it is seen there contradicts them", left)

    def _about(self, scan: Scan, prepared: SpectralScan, before: Sequence[Located]) -> Located | None:
        """Where the motion of the scans before expects it; None where it expects nothing, or the scan is not there."""
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
        found = self._registrar.register_expected(target, prepared, about)
        place = self._in_map(T_map_scan, found)
        located = self._verdict(scan, place, found, f"where the motion expects it: {found.reason}")
        return replace(located, tracked=True) if located.located and found.accepted else None

    def _in_map(self, T_map_view: RigidTransform, found: Registration) -> Place:
        """The place that a registration to the map names, as sure as that and the map's own poses are."""
        T = T_map_view * found.T_target_source
        return Place(T, found.covariance + self._map.covariance_at(T), found.probability, (), found.fixed)

    @staticmethod
    def _verdict(scan: Scan, place: Place, found: Registration, reason: str) -> Located:
        located = place.probability >= _ACCEPTED and found.is_fixed
        return Located(scan.name, scan.stamp, reason, place, located, found.psr, found.overlap)


def _step(k: int, before: Located, after: Located) -> RegisteredPair:
    """From one located scan to the next, numbers k and k + 1; the motion takes it as it is."""
    T = before.T_map_scan.inv() * after.T_map_scan
    step = Registration(T, after.covariance, after.psr, after.overlap, accepted=True, seconds=0.0)
    return RegisteredPair(k, k + 1, "sequential", registration=step)
