"""Simulated lines of a multibeam echo sounder over a random relief: true, and as recorded with biases."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonarmap.slam.pings.biases import Biases
from sonarmap.slam.pings.line import PingLine

# latency 0.2 s, roll 0.5, pitch 1 and heading 1.5 degrees
WRONG = Biases(0.2, *np.radians([0.5, 1.0, 1.5]).tolist())
LEVER = np.array([0.35, -0.2, -0.6])  # the transducer in the vehicle, x forward, y port, z up [m]
OPENING = np.radians(60.0)  # to either side
RATE = 5.0  # pings per second
DEPTH = 11.6  # below the vehicle's level at the origin [m]
NOISE = 0.02  # of ranges [m]


@dataclass(frozen=True, slots=True)
class Relief:
    """A slope and a sum of waves, longer ones higher."""

    waves: np.ndarray  # (32, 2) [rad/m]
    phases: np.ndarray  # (32,)
    heights: np.ndarray  # (32,) amplitudes [m]

    @classmethod
    def of(cls, rng: np.random.Generator, rms: float) -> "Relief":
        lengths, courses = np.geomspace(2.0, 40.0, 32), rng.uniform(0, 2 * np.pi, 32)
        waves = 2 * np.pi / lengths[:, None] * np.column_stack([np.cos(courses), np.sin(courses)])
        heights = lengths**1.5
        return cls(waves, rng.uniform(0, 2 * np.pi, 32), heights * rms / np.sqrt((heights**2).sum() / 2))

    def __call__(self, xy: np.ndarray) -> np.ndarray:
        """(N,) Up [m] at (N, 2) East and North."""
        return xy @ [0.006, -0.004] - DEPTH + np.cos(xy @ self.waves.T + self.phases) @ self.heights


@dataclass(frozen=True, slots=True)
class Lane:
    """A straight line with swinging speed."""

    name: str
    begin: np.ndarray  # (2,) East and North [m]
    course: float  # [rad] clockwise from North
    speed: float  # [m/s]
    start: float  # [s]
    phases: np.ndarray  # (6,) of the swings

    def place(self, stamps: np.ndarray) -> np.ndarray:
        """(P, 3) [m]"""
        t = stamps - self.start
        period = 23.0
        turn = 2 * np.pi / period
        along = self.speed * (t + 0.2 / turn * (np.sin(turn * t + self.phases[0]) - np.sin(self.phases[0])))
        aside = 0.4 * np.sin(2 * np.pi * t / 41.0 + self.phases[1])
        ahead = np.array([np.sin(self.course), np.cos(self.course)])
        right = np.array([np.cos(self.course), -np.sin(self.course)])
        up = 0.02 * np.sin(2 * np.pi * t / 90.0 + self.phases[1])
        return np.column_stack([self.begin + along[:, None] * ahead + aside[:, None] * right, up])

    def swings(self, stamps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(P, 3) attitudes [rad] and (P,) heave [m]."""
        t = stamps - self.start
        roll, pitch, heading, heave = (
            size * np.sin(2 * np.pi * t / period + phase)
            for size, period, phase in zip(
                (*np.radians([2.0, 1.0, 2.0]), 0.1), (6.1, 7.3, 8.7, 5.3), self.phases[2:], strict=True
            )
        )
        return np.column_stack([roll + 0.01, pitch - 0.007, self.course + 0.05 + heading]), heave


@dataclass(frozen=True, slots=True)
class Survey:
    """Lines as recorded, and the true ones."""

    recorded: list[PingLine]
    true: list[PingLine]


def simulated(
    seed: int,
    biases: Biases = WRONG,
    rms: float = 0.5,
    pings: int = 500,
    beams: int = 256,
    constant: Sequence[float] = (0.0, 0.0),
    drift: Sequence[float] = (0.0, 0.0),
) -> Survey:
    """Five lanes in alternating directions with 20 % overlap, and a crossing one.

    `constant` and `drift` are standard deviations of navigation errors, horizontally and vertically [m]: of a line's
    constant, and of swings about it with periods of 100 to 200 s.
    """
    rng = np.random.default_rng(seed)
    relief = Relief.of(rng, rms)
    both = [_recorded(relief, lane, biases, pings, beams, (constant, drift), rng) for lane in lanes(pings, rng)]
    return Survey([recorded for recorded, _ in both], [true for _, true in both])


def lanes(pings: int, rng: np.random.Generator) -> list[Lane]:
    length, spacing, course = pings / RATE * 2.0, 30.0, np.radians(23.0)
    ahead, right = (np.array([np.sin(a), np.cos(a)]) for a in (course, course + np.pi / 2))
    found: list[Lane] = []
    for k, speed in enumerate((1.6, 2.4, 1.8, 2.1, 1.5)):
        back = k % 2
        travelled = pings / RATE * speed
        begin = k * spacing * right + ahead * (length / 2 + (travelled / 2 if back else -travelled / 2))
        found.append(Lane(f"lane {k}", begin, course + np.pi * back, speed, 1e6 + 200 * k, rng.uniform(0, 6, 6)))
    begin = ahead * length * 0.45 + right * (2 * spacing - pings / RATE * 0.5 * 2.2)
    across = Lane("across", begin, course + np.radians(97.0), 2.2, 1e6 + 1200, rng.uniform(0, 6, 6))
    return [*found, across]


def _recorded(
    relief: Relief,
    lane: Lane,
    biases: Biases,
    pings: int,
    beams: int,
    navigation: tuple[Sequence[float], Sequence[float]],
    rng: np.random.Generator,
) -> tuple[PingLine, PingLine]:
    stamps = lane.start + np.arange(pings) / RATE
    places = lane.place(stamps)
    attitudes, heave = lane.swings(stamps)
    R_level_vehicle = np.array([tilted(roll, pitch) for roll, pitch, _ in attitudes])
    R_vehicle_sounder = turned(biases.heading) @ tilted(biases.roll, biases.pitch)
    R_world_level = np.array([turned(heading - np.pi / 2) for heading in attitudes[:, 2]])
    sensors = R_level_vehicle @ LEVER + heave[:, None] * [0, 0, 1]
    angles = np.linspace(-OPENING, OPENING, beams)
    beam = np.column_stack([np.zeros(beams), -np.sin(angles), -np.cos(angles)])
    assumed = np.einsum("pij,bj->pbi", R_level_vehicle, beam)
    really = np.einsum("pij,bj->pbi", R_level_vehicle @ R_vehicle_sounder, beam)
    origins = places + np.einsum("pij,pj->pi", R_world_level, sensors)
    rays = np.einsum("pij,pbj->pbi", R_world_level, really).reshape(-1, 3)
    ranges = intersected(relief, np.repeat(origins, beams, axis=0), rays) + NOISE * rng.standard_normal(len(rays))
    of = np.repeat(np.arange(pings), beams)
    errors = _errors(stamps - lane.start, navigation, rng)
    late = lane.place(stamps - biases.latency) + errors
    both = [
        PingLine(lane.name, stamps, where, attitudes, sensors, of, sensors[of] + ranges[:, None] * ray.reshape(-1, 3))
        for where, ray in ((late, assumed), (places, really))
    ]
    return both[0], both[1]


def _errors(
    times: np.ndarray, navigation: tuple[Sequence[float], Sequence[float]], rng: np.random.Generator
) -> np.ndarray:
    """(P, 3) East, North, Up [m]."""
    constant, drift = (np.array([level, level, up]) for level, up in navigation)
    turns = 2 * np.pi * times[:, None] / rng.uniform(100, 200, 3) + rng.uniform(0, 2 * np.pi, 3)
    return constant * rng.standard_normal(3) + np.sqrt(2) * drift * np.sin(turns)


def intersected(relief: Relief, origins: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """(N,) ranges of the relief along rays [m], by the secant method."""

    def above(r: np.ndarray) -> np.ndarray:
        at = origins + r[:, None] * rays
        return at[:, 2] - relief(at[:, :2])

    far = (origins[:, 2] + DEPTH) / -rays[:, 2]
    near = 0.9 * far
    f_near, f_far = above(near), above(far)
    for _ in range(7):
        slope = (f_far - f_near) / np.where(far == near, 1, far - near)
        usable = np.abs(slope) > 0.05
        near, f_near, far = far, f_far, far - np.where(usable, f_far / np.where(usable, slope, 1), 0)
        f_far = above(far)
    return far


def tilted(roll: float, pitch: float) -> np.ndarray:
    """(3, 3) rotation from axes that are rolled starboard side down and then pitched bow up."""
    a, b, c, d = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    return np.array([[c, 0, -d], [0, 1, 0], [d, 0, c]]) @ np.array([[1, 0, 0], [0, a, -b], [0, b, a]])


def turned(heading: float) -> np.ndarray:
    """(3, 3) rotation from axes that are turned clockwise."""
    a, b = np.cos(heading), np.sin(heading)
    return np.array([[a, b, 0], [-b, a, 0], [0, 0, 1]])
