"""Search for two sweeps of a scene with a wanted overlap: few rays propose, all rays decide."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.simulate.kinds.kind import RELIEF_OF, KindPair, noise_of, pair_draws
from sonarmap.tools.lab.simulate.kinds.sweep import Fan, Returns, Sweep, Water, meet, pick, true_points, write_scan
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.viewpoints import OVERLAP_RADIUS, Candidate, WantedOverlap, find_partner

PLACES = 6  # targets that are tried before a pair is given up
TRIES = 60  # sources that are tried for each target
THIN = 8  # the coarse search takes every THIN-th ping and beam
DOUBT = 0.12  # largest difference between the overlap of the coarse points and that of all
SEEN_LEAST = 0.2  # least share of the beams with an echo
STRUCTURED = ("rich", "twins")  # reliefs of scenes that show more than their bed
STRUCTURE = 0.05  # least share of a scan's points there that are off their best-fitting plane
BED_RELIEF = 0.015  # least distance of these from the plane, in shares of the maximum range


@dataclass(frozen=True, slots=True)
class Instrument(ABC):
    """A sonar with its vehicle in a scene: where it may sweep, and which echoes it picks."""

    pulse: ClassVar[float] = 0.0  # length of the pulse in range, in shares of the maximum range
    water: Water
    fan: Fan  # the beams of one ping

    @abstractmethod
    def target(self, rng: np.random.Generator) -> Sweep:
        """Draw a sweep anywhere in the scene."""

    @abstractmethod
    def source(self, target: Sweep, overlaps: tuple[float, float], rng: np.random.Generator) -> Sweep:
        """Draw a sweep that may have such an overlap with the target."""

    def returns(
        self, ranges: np.ndarray, strengths: np.ndarray, sweep: Sweep, rng: np.random.Generator | None
    ) -> Returns:
        """Pick the strongest echo of each beam from those of all rays; without a generator, free of noise and
        distortion."""
        return pick(self.fan, ranges, strengths, self.pulse * self.fan.sensor.max_range)


@dataclass(frozen=True, slots=True)
class Seen:
    """A sweep, the echoes of its rays, and the true points (N, 3) of the picked ones [m, frame of the scan]."""

    sweep: Sweep
    ranges: np.ndarray
    strengths: np.ndarray
    points: np.ndarray


@dataclass(frozen=True, slots=True)
class SweepKind:
    """A kind of pair: two sweeps of one scene by one instrument."""

    name: str  # a key of SCAN_KINDS
    scenes: tuple[str, ...]  # keys of SCENE_KINDS, in turns; every relief is among them
    equip: Callable[[Water, np.random.Generator], Instrument]  # draws the instrument
    seen_from: bool = True  # whether scans of even numbers have viewpoints

    def pair(self, number: int, seed: int, scene: str, overlaps: tuple[float, float]) -> KindPair:
        """Simulate pair `number` of the set `seed`. Raises InputError: no such pair was found."""
        draws = pair_draws(self.name, number, seed)
        instrument = self.equip(Water(build_scene(scene, draws.scene)), draws.poses)
        target, source, shared = _search(instrument, overlaps, draws.poses)
        noise = noise_of(number, self.scenes)
        # scale the noise from the maximum range of the scene's sensor to that of the sonar; no ghosts
        gate = instrument.fan.sensor.max_range / instrument.water.sensor.max_range
        noise = replace(noise, sigma2=noise.sigma2 * gate, ghosts=0.0)
        scans = []
        for seen, name, rng in ((target, "target", draws.target), (source, "source", draws.source)):
            returns = instrument.returns(seen.ranges, seen.strengths, seen.sweep, rng)
            scan = write_scan(instrument.fan, seen.sweep, returns, noise, rng, name)
            scans.append(scan if self.seen_from and number % 2 == 0 else replace(scan, viewpoints=None))
        poses = target.sweep.T_world_frame, source.sweep.T_world_frame
        return KindPair(self.name, number, seed, scene, scans[0], scans[1], *poses, shared)


def _search(
    instrument: Instrument, overlaps: tuple[float, float], rng: np.random.Generator
) -> tuple[Seen, Seen, float]:
    """Draw a target and a source, and their overlap."""

    def candidates(target: Sweep) -> Iterator[Candidate[Seen]]:
        for _ in range(TRIES):
            sweep = instrument.source(target, overlaps, rng)
            few = _coarse(instrument, sweep)
            if few is not None:
                yield sweep.T_world_frame, few, partial(_look, instrument, sweep)

    wanted = WantedOverlap(*overlaps, OVERLAP_RADIUS * instrument.water.scale, DOUBT, THIN**2)
    for _ in range(PLACES):
        target = _first(instrument, rng)
        match = find_partner(target.points, target.sweep.T_world_frame, candidates(target.sweep), wanted)
        if match is not None:
            return target, *match
    raise InputError(
        f"no two sweeps of {instrument.water.scene.name} have an overlap within {overlaps[0]:g} to {overlaps[1]:g}: "
        f"{PLACES} targets, {TRIES} sources tried for each; widen the range or take another number"
    )


def _first(instrument: Instrument, rng: np.random.Generator) -> Seen:
    """Draw a target that sees enough."""
    for _ in range(4 * TRIES):
        sweep = instrument.target(rng)
        if _coarse(instrument, sweep) is not None and (seen := _look(instrument, sweep)) is not None:
            return seen
    scene, sensor = instrument.water.scene, instrument.fan.sensor
    raise InputError(f"{scene.name} has no clear path for a sweep of {sensor.name}; take another scene")


def _look(instrument: Instrument, sweep: Sweep) -> Seen | None:
    """The sweep as seen by all rays; None if its path is blocked or it sees too little."""
    water = instrument.water
    ranges, strengths = meet(water.scene, instrument.fan, sweep.T_world_ping)
    returns = instrument.returns(ranges, strengths, sweep, None)
    if not water.is_clear(returns.ranges, SEEN_LEAST) or not water.is_way_free(sweep.T_world_ping.translation):
        return None
    points = true_points(instrument.fan, sweep, returns)
    if not _shows_structure(water, points[::THIN], STRUCTURE):
        return None
    return Seen(sweep, ranges, strengths, points)


def _coarse(instrument: Instrument, sweep: Sweep) -> np.ndarray | None:
    """Points (N, 3) [m], frame of the scan, of a few rays; None if they already rule the sweep out."""
    water, few, pings = instrument.water, instrument.fan.thinned(THIN), sweep.thinned(THIN)
    T_world_ping = pings.T_world_ping
    if not water.is_free(T_world_ping.translation):
        return None
    returns = pick(few, *meet(water.scene, few, T_world_ping))
    if not water.is_clear(returns.ranges, SEEN_LEAST) or water.ends(few, T_world_ping, returns.ranges):
        return None
    points = true_points(few, pings, returns)
    return points if _shows_structure(water, points, STRUCTURE / 2) else None


def _shows_structure(water: Water, points: np.ndarray, least: float) -> bool:
    """Whether a share `least` of the points (N, 3) [m] lies off their best-fitting plane, or the scene has no more than
    its bed to show."""
    if RELIEF_OF[water.scene.name] not in STRUCTURED:
        return True
    away = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(away.T @ away)
    return bool((np.abs(away @ axes[:, 0]) > BED_RELIEF * water.sensor.max_range).mean() >= least)
