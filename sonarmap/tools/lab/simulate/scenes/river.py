"""A river's bed between its banks, and a bridge's piers in it: scour, shafts, fenders, driftwood caught by them."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.tools.lab.simulate.scenes.bed import raster, relief
from sonarmap.tools.lab.simulate.shapes.solids import Mesh, box, cylinder, prism, rod

SLOPE = 0.5  # of the banks
TOE = 14.0  # from a bank's line to where its slope begins [m]
BANK_TOP = 5.0  # above the water [m]


@dataclass(frozen=True, slots=True)
class River:
    """What the seed decides of a river's plan."""

    bed: float  # mean height of its bed [m]
    south: float  # y of the banks' lines at x = 0 [m]
    north: float  # likewise
    bend: tuple[float, float, float]  # amplitude [m], wave number [rad/m] and phase [rad] by which both wind
    channel_y: float  # of the channel at x = 0 [m]
    channel_width: float  # [m]
    channel_depth: float  # below the bed [m]
    shoals: np.ndarray  # (K, 4): x, y, radius and height [m] of each

    def winding(self, x: np.ndarray) -> np.ndarray:
        """By how much the river lies farther north at `x` than at 0 [m]."""
        amplitude, number, phase = self.bend
        return amplitude * (np.sin(number * x + phase) - np.sin(phase))


def river_of(rng: np.random.Generator) -> River:
    """A river 175 to 205 m wide and 12 to 15 m deep."""
    shoals = rng.uniform((-110, -70, 10, -1.5), (110, 70, 26, 3.5), (int(rng.integers(2, 6)), 4))
    return River(
        bed=rng.uniform(-15.0, -12.0),
        south=rng.uniform(-101.0, -88.0),
        north=rng.uniform(88.0, 101.0),
        bend=(rng.uniform(2.0, 8.0), 2 * np.pi / rng.uniform(180.0, 320.0), rng.uniform(0, 2 * np.pi)),
        channel_y=rng.uniform(-45.0, 45.0),
        channel_width=rng.uniform(12.0, 22.0),
        channel_depth=rng.uniform(2.5, 5.0),
        shoals=shoals,
    )


def ground(river: River, piers: list[tuple[float, float, float, float]], rng: np.random.Generator) -> np.ndarray:
    """Bed and banks on raster() x raster() [m]. The bed is scoured about the upstream end and along the sides of each
    pier (x, y, length and width [m]), and what was carried off lies behind it."""
    x, y = np.meshgrid(raster(), raster(), indexing="ij")
    wind = river.winding(x)
    bed = river.bed + 0.8 * relief(rng)
    # the channel winds half as much again as the banks do
    bed -= river.channel_depth * np.exp(-(((y - river.channel_y - 1.5 * wind) / river.channel_width) ** 2))
    for east, north, radius, rise in river.shoals:
        bed += rise * np.exp(-((((x - east) / (2 * radius)) ** 2) + ((y - north) / radius) ** 2))
    for east, north, length, width in piers:
        deep, wide = rng.uniform(1.2, 2.6) + 0.3 * width, 2.2 * width
        ahead, behind = east - length / 2, east + length / 2 + 14
        bed -= deep * np.exp(-(((x - ahead) / wide) ** 2) - ((y - north) / wide) ** 2)
        bed -= 0.5 * deep * np.exp(-(((x - east) / (0.6 * length)) ** 2) - ((y - north) / wide) ** 2)
        bed += 0.35 * deep * np.exp(-(((x - behind) / 14) ** 2) - ((y - north) / (1.3 * width)) ** 2)
    inland = np.maximum(y - wind - river.north, river.south + wind - y) + TOE
    return bed + np.clip(SLOPE * inland, 0, BANK_TOP - river.bed)


FOOT = -34.0  # below the lowest bed: where piers and piles end [m]


@dataclass(frozen=True, slots=True)
class Pier:
    """One pier."""

    x: float  # of its middle [m]
    y: float  # likewise
    length: float  # along the flow [m]
    width: float  # across the flow [m]
    footing: float  # how far its footing reaches beyond it on all sides [m]
    footing_top: float  # height of that [m]
    round: bool  # whether its ends are round rather than pointed
    fenced: bool  # whether it stands beside the fairway and has fenders
    turned: float  # its heading against the flow [rad]


def outline(length: float, width: float, is_round: bool) -> np.ndarray:
    """A pier's plan (K, 2), counterclockwise, its ends pointed or half circles."""
    straight, half = length / 2 - width / 2, width / 2
    angle = np.linspace(-np.pi / 2, np.pi / 2, 7 if is_round else 3)[:, None]
    end = np.column_stack([np.cos(angle), np.sin(angle)]) * half
    return np.concatenate([end + np.array((straight, 0)), -end - np.array((straight, 0))])


def _placed(pier: Pier, mesh: Mesh) -> Mesh:
    """A mesh of the pier's frame, x along it, in the scene's."""
    return mesh.moved(Rotation.from_euler("z", pier.turned), (pier.x, pier.y, 0.0))


def shaft(pier: Pier, deck: tuple[float, float], heading: float) -> list[Mesh]:
    """The shaft, its footing with a step, and the cap that carries the deck."""
    underside, width = deck
    reach = 2 * pier.footing
    parts = [
        prism(outline(pier.length, pier.width, pier.round), FOOT, underside - 1.4),
        prism(outline(pier.length + reach, pier.width + reach, False), FOOT, pier.footing_top),
        prism(outline(pier.length + reach / 2, pier.width + reach / 2, False), FOOT, pier.footing_top + 1.1),
    ]
    turn = Rotation.from_euler("z", heading - pier.turned)
    cap = box((0, 0, underside - 0.8), (1.2 * pier.width, width, 1.6), turn)
    return [_placed(pier, part) for part in [*parts, cap]]


def fenders(pier: Pier, rng: np.random.Generator) -> list[Mesh]:
    """Rows of piles with a waling along both sides, a dolphin before either end, one of them out of line."""
    aside, parts = pier.width / 2 + pier.footing + 1.0, []
    for side in (-1, 1):
        for along in np.arange(-pier.length / 2, pier.length / 2 + 0.1, rng.uniform(3.0, 4.5)):
            foot = (along, side * (aside + 0.6), FOOT)
            parts.append(cylinder(foot, (along, side * aside, 2.5), 0.35, sides=10))
        parts.append(box((0, side * (aside - 0.3), rng.uniform(-0.8, 0.6)), (pier.length + 1.5, 0.5, 0.7)))
    for end in (-1, 1):
        middle = np.array((end * (pier.length / 2 + rng.uniform(6.0, 11.0)), rng.uniform(-1.5, 1.5), 0.0))
        for turn in 2 * np.pi * (np.arange(rng.integers(3, 6)) + rng.random()) / 5:
            lean = np.array((np.cos(turn), np.sin(turn), 0.0))
            foot, head = (middle + out * lean + np.array((0, 0, z)) for out, z in ((2.2, FOOT), (0.6, 3.5)))
            parts.append(cylinder(foot, head, 0.4, sides=10))
    return [_placed(pier, part) for part in parts]


def driftwood(pier: Pier, bed: float, rng: np.random.Generator) -> list[Mesh]:
    """Driftwood that the flow has laid against the pier's upstream end, more or none of it."""
    parts = []
    for _ in range(rng.integers(0, 5)):
        middle = np.array((-pier.length / 2 - rng.uniform(0.5, 3.0), rng.uniform(-3.0, 3.0), 0.0))
        middle[2] = max(pier.footing_top, bed) + rng.uniform(0.3, 3.0)
        reach = Rotation.from_euler("ZYX", rng.uniform((0.8, -0.4, 0), (2.3, 0.4, 0))).apply((rng.uniform(2, 6), 0, 0))
        parts.append(rod(middle, reach, rng.uniform(0.2, 0.55), sides=8))
    return [_placed(pier, part) for part in parts]
