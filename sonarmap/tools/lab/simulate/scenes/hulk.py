"""A ship's hull without its decks, in pieces: open skins, bulkheads, what is left of the decks, the stern's gear."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.simulate.shapes.solids import Mesh, box, cylinder, loft, shell

PLATE = 0.45  # thickness of the skin with its frames [m]
SPACING = 2.2  # of the stations [m]
GIRTH = 19  # corners of a section from rail to rail


@dataclass(frozen=True, slots=True)
class Hulk:
    """The hull's measures; its frame is x to the bow from midships, y to port, z up from the keel."""

    length: float  # of the hull [m]
    beam: float  # [m]
    depth: float  # from keel to rail [m]

    def half_width(self, along: float) -> float:
        """At the rail, `along` in shares of the length from midships [m]."""
        fine = np.clip(1 - max(along - 0.2, 0) * 2.2, 0.12, 1)
        return 0.5 * self.beam * float(np.clip(1 - abs(2 * along) ** 5, 0.12, 1) * fine)

    def section(self, along: float, inset: float = 0.0) -> np.ndarray:
        """(GIRTH, 3) [m] from the port rail round the keel to the starboard one, so far within the skin."""
        width = self.half_width(along)
        angle = np.linspace(0, np.pi, GIRTH)
        across = max(width - inset, 0.3 * width) * np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** 0.5
        # the bottom rises to the stern and to the bow
        rise = self.depth * (0.5 * np.clip(-along - 0.34, 0, 1) * 5 + 0.3 * np.clip(along - 0.42, 0, 1) * 5)
        deep = (self.depth - rise - inset) * np.sin(angle) ** 0.6
        return np.column_stack([np.full(GIRTH, along * self.length), across, self.depth - deep])


def skin(hulk: Hulk, aft: float, ahead: float, rng: np.random.Generator) -> Mesh:
    """The open shell between two stations: torn where it broke, its sides fallen in or gone here and there."""
    count = max(round((ahead - aft) * hulk.length / SPACING), 4) + 1
    stations = np.linspace(aft, ahead, count)
    outer = np.array([hulk.section(along) for along in stations])
    inner = np.array([hulk.section(along, PLATE) for along in stations])
    for end, broken in ((0, aft > -0.5), (-1, ahead < 0.5)):
        torn = broken * rng.uniform(-0.9, 2.2, GIRTH) * (1 if end else -1)
        outer[end, :, 0] += torn
        inner[end, :, 0] += torn
    for _ in range(int(rng.integers(2, 6))):
        middle, reach, side = rng.uniform(aft, ahead), rng.uniform(0.02, 0.07), rng.choice((-1, 1))
        hit = np.exp(-(((stations - middle) / reach) ** 2))[:, None] * np.clip(side * outer[..., 1], 0, None)
        hit *= 2 / hulk.beam
        down, within = rng.uniform(0.15, 0.55), rng.uniform(-0.12, 0.3)
        for sheet in (outer, inner):
            sheet[..., 1] *= 1 - within * hit
            sheet[..., 2] *= 1 - down * hit
    return shell(outer, inner)


def bulkheads(hulk: Hulk, aft: float, ahead: float, rng: np.random.Generator) -> list[Mesh]:
    """Transverse ones at uneven distances, of different heights."""
    parts, along = [], aft + 0.03
    while along < ahead - 0.02:
        ring = hulk.section(along, 0.5 * PLATE)[::-1]
        ring[:, 2] = np.minimum(ring[:, 2], ring[:, 2].min() + rng.uniform(0.4, 0.95) * np.ptp(ring[:, 2]))
        ring = ring[np.concatenate([[True], np.linalg.norm(np.diff(ring, axis=0), axis=1) > 1e-6])]
        parts.append(loft([ring, ring + np.array((0.4, 0.0, 0.0))]))
        along += rng.uniform(0.06, 0.15)
    return parts


def remains(hulk: Hulk, aft: float, ahead: float, rng: np.random.Generator) -> list[Mesh]:
    """Strips of deck along the rails, a hatch's coaming, deck beams from side to side."""
    parts = []
    for along in np.arange(aft + 0.02, ahead - 0.02, 0.045):
        east, width = along * hulk.length, hulk.half_width(along)
        if rng.random() < 0.55:
            side = rng.choice((-1, 1))
            tilt = Rotation.from_euler("x", side * rng.uniform(-0.1, 0.5))
            size = (0.04 * hulk.length, 0.5 * width, 0.35)
            parts.append(box((east, side * 0.72 * width, hulk.depth * rng.uniform(0.82, 0.97)), size, tilt))
        if rng.random() < 0.5:
            parts.append(box((east, 0, hulk.depth * rng.uniform(0.85, 0.95)), (0.6, 1.9 * width, 0.5)))
    if ahead - aft > 0.2:
        middle = (aft + ahead) / 2 + rng.uniform(-0.04, 0.04)
        for side in (-1, 1):
            across = side * 0.4 * hulk.half_width(middle)
            parts.append(box((middle * hulk.length, across, 1.03 * hulk.depth), (0.1 * hulk.length, 0.4, 1.6)))
    return parts


def gear(hulk: Hulk, rng: np.random.Generator) -> list[Mesh]:
    """Of the stern: the deck house with its funnel, an engine, shaft, propeller and rudder."""
    length, depth = hulk.length, hulk.depth
    house = rng.uniform((0.1, 0.6, 3.0), (0.14, 0.8, 4.5)) * (length, hulk.beam, 1.0)
    place = np.array((-0.4 * length, rng.uniform(-0.05, 0.05) * hulk.beam, depth + 0.5 * house[2] - 0.4))
    top = place + np.array((rng.uniform(-0.02, 0.02) * length, 0, 0.4 * house[2]))
    lean = rng.uniform(-0.8, 0.8, 2)
    hub = np.array((-0.5 * length - 0.6, 0.0, 0.34 * depth))
    rudder = Rotation.from_euler("z", rng.uniform(-0.5, 0.5))
    parts = [
        box(place, house, Rotation.from_euler("x", rng.uniform(-0.12, 0.12))),
        box(place + np.array((0.3 * house[0], 0, 0.5 * house[2] + 0.8)), (0.3 * house[0], 0.9 * house[1], 2.0)),
        cylinder(top, top + np.array((*lean, rng.uniform(2.0, 3.5))), rng.uniform(0.9, 1.5)),
        box((-0.33 * length, 0, 0.35 * depth), (0.07 * length, 0.3 * hulk.beam, 0.4 * depth)),
        cylinder(hub, hub + np.array((0.12 * length, 0, 0)), 0.35, 12),
        box(hub - np.array((1.6, 0, -0.05 * depth)), (1.6, 0.35, 0.5 * depth), rudder),
    ]
    first = rng.uniform(0, np.pi)
    for blade in range(4):
        spin = Rotation.from_euler("xz", (first + blade * np.pi / 2, 0.0))
        parts.append(box(hub + spin.apply((0, 0, 0.14 * depth)), (0.3, 0.09 * depth, 0.24 * depth), spin))
    return parts
