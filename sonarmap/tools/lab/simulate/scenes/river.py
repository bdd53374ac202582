"""A river's bed between its banks: a winding channel, shoals, scour about what stands in the flow along x."""

from dataclasses import dataclass

import numpy as np

from sonarmap.tools.lab.simulate.scenes.bed import raster, relief

SLOPE = 0.5  # of the banks
TOE = 14.0  # from a bank's line to where its slope begins [m]
BANK_TOP = 5.0  # above the water [m]


@dataclass(frozen=True, slots=True)
class River:
    """What the seed decides of a river's plan.

    Attributes:
        bed: mean height of its bed [m].
        south, north: y of the banks' lines at x = 0 [m].
        bend: amplitude [m], wave number [rad/m] and phase [rad] by which both wind.
        channel_y, channel_width, channel_depth: of the channel at x = 0, and how deep it is below the bed [m].
        shoals: (K, 4): x, y, radius and height [m] of each.
    """

    bed: float
    south: float
    north: float
    bend: tuple[float, float, float]
    channel_y: float
    channel_width: float
    channel_depth: float
    shoals: np.ndarray

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
    """Bed and banks on raster() x raster() [m].

    Args:
        river: the plan.
        piers: x, y, length and width of each thing that stands along the flow [m]. The bed is scoured about its
            upstream end and along its sides, and what was carried off lies behind it.
        rng: of the relief, and of how deep the scour is.
    """
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
