"""Main lobes wider than the beams' spacing: echoes fade in patches, and neighboring beams report one echo."""

import numpy as np
from scipy.ndimage import gaussian_filter

from sonarmap.tools.lab.simulate.sensing.sensors import Echoes

FADING, FADED = 4.0, 3.0  # width of what fades together [beams], standard deviation [dB]


def fade(echoes: Echoes, rng: np.random.Generator) -> Echoes:
    """Echoes stronger and weaker by patches, as water and surface have it."""
    fading = gaussian_filter(rng.standard_normal(echoes.ranges.shape), FADING, mode="wrap")
    return Echoes(echoes.ranges, echoes.strengths * 10 ** (FADED / 10 * fading / fading.std()))


def pick_strongest(echoes: Echoes, lobe: float) -> Echoes:
    """For every beam range and strength of the strongest echo of its lobe, weighted by the lobe.

    Args:
        echoes: of thin beams, (rows, columns).
        lobe: standard deviation of the main lobe, in beams; it is taken over twice as many to either side.
    """
    reach = int(np.ceil(2 * lobe))
    padded = Echoes(np.pad(echoes.ranges, reach, constant_values=np.inf), np.pad(echoes.strengths, reach))
    rows, columns = echoes.ranges.shape
    best = Echoes(np.full((rows, columns), np.inf), np.zeros((rows, columns)))
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            window = (slice(reach + i, reach + i + rows), slice(reach + j, reach + j + columns))
            seen = padded.strengths[window] * np.exp(-0.5 * (i**2 + j**2) / lobe**2)
            stronger = seen > best.strengths
            ranges = np.where(stronger, padded.ranges[window], best.ranges)
            best = Echoes(ranges, np.where(stronger, seen, best.strengths))
    return best
