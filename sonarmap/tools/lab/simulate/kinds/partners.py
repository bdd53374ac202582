"""Two sweeps of one scene with a wanted overlap: searched with few rays, decided with all."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.simulate.kinds.draws import noise_of, pair_draws
from sonarmap.tools.lab.simulate.kinds.kind import KindPair, relief_of
from sonarmap.tools.lab.simulate.kinds.sweep import Fan, Returns, Sweep, Water, meet, pick, true_points, write_scan
from sonarmap.tools.lab.simulate.scenes.scene import build_scene
from sonarmap.tools.lab.simulate.sensing.overlap import OVERLAP_RADIUS
from sonarmap.tools.lab.simulate.viewpoints import Candidate, WantedOverlap, find_partner

PLACES = 6  # of the target, before a pair is given up
TRIES = 60  # of either sweep at each place
THIN = 8  # the coarse search takes every THIN-th ping and beam
DOUBT = 0.12  # an overlap by the coarse points is at most this far from the one by all
SEEN_LEAST = 0.2  # of the beams
STRUCTURED = ("rich", "twins")  # reliefs of scenes that show a scan more than their bed
STRUCTURE = 0.05  # least share of such a scan's points off the plane that fits it best
BED_RELIEF = 0.015  # by which they are off it, in shares of the maximum range


class Instrument(Protocol):
    """A sonar with its vehicle in a scene: where it may sweep, and which echoes it picks."""

    @property
    def fan(self) -> Fan: ...

    def target(self, rng: np.random.Generator) -> Sweep:
        """A sweep anywhere in the scene."""
        ...

    def source(self, target: Sweep, overlaps: tuple[float, float], rng: np.random.Generator) -> Sweep:
        """A sweep that may have such an overlap with the target."""
        ...

    def returns(
        self, ranges: np.ndarray, strengths: np.ndarray, sweep: Sweep, rng: np.random.Generator | None
    ) -> Returns:
        """The picked echoes of what all rays meet; without a generator, free of noise and distortion."""
        ...


@dataclass(frozen=True, slots=True)
class Seen:
    """A sweep, what its rays meet, and where the echoes came from: (N, 3) [m], frame of the scan."""

    sweep: Sweep
    ranges: np.ndarray
    strengths: np.ndarray
    points: np.ndarray


@dataclass(frozen=True, slots=True)
class SweepKind:
    """Pairs of two sweeps of an instrument through one scene."""

    name: str  # a key of SCAN_KINDS
    scenes: tuple[str, ...]  # keys of SCENE_KINDS, in turns; every relief is among them
    equip: Callable[[Water, np.random.Generator], Instrument]  # draws the instrument
    seen_from: bool = True  # whether the points of even numbers say where they were seen from

    def pair(self, number: int, seed: int, scene: str, overlaps: tuple[float, float]) -> KindPair:
        """As `kind_pair` makes it. Raises InputError: no such pair was found."""
        draws = pair_draws(self.name, number, seed)
        water = Water(build_scene(scene, draws.scene))
        instrument = self.equip(water, draws.poses)
        target, source, shared = _search(water, instrument, overlaps, draws.poses)
        noise = noise_of(number, self.scenes)
        # of a sonar that listens up to a share of the range that the noise is of; without ghosts
        gate = instrument.fan.sensor.max_range / water.sensor.max_range
        noise = replace(noise, sigma2=noise.sigma2 * gate, ghosts=0.0)
        scans = []
        for seen, name, rng in ((target, "target", draws.target), (source, "source", draws.source)):
            returns = instrument.returns(seen.ranges, seen.strengths, seen.sweep, rng)
            scan = write_scan(instrument.fan, seen.sweep, returns, noise, rng, name)
            scans.append(scan if self.seen_from and number % 2 == 0 else replace(scan, viewpoints=None))
        poses = target.sweep.T_world_frame, source.sweep.T_world_frame
        return KindPair(self.name, number, seed, scene, scans[0], scans[1], *poses, shared)


def _search(
    water: Water, instrument: Instrument, overlaps: tuple[float, float], rng: np.random.Generator
) -> tuple[Seen, Seen, float]:
    """Target, source and what they share."""

    def candidates(target: Sweep) -> Iterator[Candidate[Seen]]:
        for _ in range(TRIES):
            sweep = instrument.source(target, overlaps, rng)
            few = _coarse(water, instrument.fan, sweep)
            if few is not None:
                yield sweep.T_world_frame, few, partial(_look, water, instrument, sweep)

    wanted = WantedOverlap(*overlaps, OVERLAP_RADIUS * water.scale, DOUBT, THIN**2)
    for _ in range(PLACES):
        target = _first(water, instrument, rng)
        found = find_partner(target.points, target.sweep.T_world_frame, candidates(target.sweep), wanted)
        if found is not None:
            return target, *found
    raise InputError(
        f"no two sweeps of {water.scene.name} have an overlap within {overlaps[0]:g} to {overlaps[1]:g}: {PLACES} "
        f"targets, {TRIES} sources tried for each; widen the range or take another number"
    )


def _first(water: Water, instrument: Instrument, rng: np.random.Generator) -> Seen:
    """A target that sees enough."""
    for _ in range(4 * TRIES):
        sweep = instrument.target(rng)
        if _coarse(water, instrument.fan, sweep) is not None and (seen := _look(water, instrument, sweep)) is not None:
            return seen
    raise InputError(
        f"{water.scene.name} has no clear way for a sweep of {instrument.fan.sensor.name}; take another scene"
    )


def _look(water: Water, instrument: Instrument, sweep: Sweep) -> Seen | None:
    """What all rays show; None where the way is blocked or too little is seen."""
    ranges, strengths = meet(water.scene, instrument.fan, sweep.T_world_ping)
    returns = instrument.returns(ranges, strengths, sweep, None)
    if not water.is_clear(returns.ranges, SEEN_LEAST):
        return None
    if not water.is_way_free(sweep.T_world_ping.translation):
        return None
    points = true_points(instrument.fan, sweep, returns)
    if not _shows_structure(water, points[::THIN], STRUCTURE):
        return None
    return Seen(sweep, ranges, strengths, points)


def _coarse(water: Water, fan: Fan, sweep: Sweep) -> np.ndarray | None:
    """Points (N, 3) [m], frame of the scan, of a few rays; None where these already show that the sweep will not do."""
    few, pings = fan.thinned(THIN), sweep.thinned(THIN)
    T_world_ping = pings.T_world_ping
    if not water.is_free(T_world_ping.translation):
        return None
    returns = pick(few, *meet(water.scene, few, T_world_ping))
    if not water.is_clear(returns.ranges, SEEN_LEAST) or water.ends(few, T_world_ping, returns.ranges):
        return None
    points = true_points(few, pings, returns)
    return points if _shows_structure(water, points, STRUCTURE / 2) else None


def _shows_structure(water: Water, points: np.ndarray, least: float) -> bool:
    """Whether a share `least` of the points (N, 3) [m] lies off the plane that fits them best, where a scene has more
    to show than its bed."""
    if relief_of(water.scene.name) not in STRUCTURED:
        return True
    away = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(away.T @ away)
    return bool((np.abs(away @ axes[:, 0]) > BED_RELIEF * water.sensor.max_range).mean() >= least)
