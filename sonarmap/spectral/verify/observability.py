"""How sharply two scans agree at a pose: their correlation along the directions that the planes fix least."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.device.arrays import Pending
from sonarmap.spectral.prepare.spectral_scan import WHITENINGS, CoarseVolume
from sonarmap.spectral.translation import Translation
from sonarmap.spectral.verify.fit import Fit

# From and up to where the highest correlation is taken, for each band of distances, and its steps [coarse voxels].
BANDS, _STEP = ((1.5, 3.0), (3.0, 6.0), (6.0, 12.0)), 0.5
# The peak is the highest correlation no farther off than this [coarse voxels].
_PEAK = 1.0
# Turns either way [rad], about so many axes.
_TURN, TURNED = float(np.deg2rad(10.0)), 2
# What a correlation beside the peak is at least and at most, as a share of it.
_LEAST, _MOST = 0.02, 2.0


@dataclass(frozen=True, slots=True)
class Observability:
    """What is left of the translation's correlation beside a pose, as shares of its peak: 1 where nothing changes."""

    axes: np.ndarray  # (3, 3) in columns, directions in the target's axes, the least fixed first
    # (3, bands, whitenings) the highest along each direction, either way, of each of BANDS and WHITENINGS
    slides: np.ndarray
    turns: np.ndarray  # (TURNED,) about each of the least fixed axes, the higher one of both ways; phase only


def observe_directions(
    correlation: Translation, target: CoarseVolume, source: CoarseVolume, fit: Fit, scale: float
) -> Pending[Observability]:
    """Queue the correlations of two scans about a pose, with WHITENINGS.

    Args:
        correlation: of the coarse grid.
        fit: the pose, and the information that says which directions the planes fix least.
        scale: coarse voxels in a voxel.
    """
    turning, shifting = weakest(fit.information)
    steps = np.arange(-BANDS[-1][1], BANDS[-1][1] + _STEP / 2, _STEP)
    places = fit.shift * scale + (shifting.T[:, None] * steps[:, None]).reshape(-1, 3)
    profile = correlation.profile(target, source, fit.R, places)
    turns = np.array([sign * _TURN * axis for axis in turning.T[:TURNED] for sign in (1, -1)])
    R = Rotation.from_rotvec(turns) * fit.R
    turned = correlation.find_at(target, source, R, np.tile(fit.shift * scale, (len(turns), 1)))

    def read() -> Observability:
        around = np.array([peak.value for peak in turned.read()]).reshape(-1, 2).max(axis=1)
        values = profile.read().reshape(len(WHITENINGS), 3, len(steps))
        away = np.abs(steps)
        peak = values[:, :, away <= _PEAK].max(axis=(1, 2))
        bands = [values[:, :, (away > low) & (away <= high)].max(axis=2) for low, high in BANDS]
        slides = np.stack(bands, axis=-1).transpose(1, 2, 0) / np.maximum(peak, 1e-12)
        return Observability(shifting, _share(slides), _share(around / max(float(peak[0]), 1e-12)))

    return Pending(read)


def weakest(information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The directions (3, 3) of turns and of shifts, in columns, by (6, 6) information, the least fixed first.

    Of each what is left where the other is free to follow.
    """
    axes = []
    for own, other in ((slice(0, 3), slice(3, 6)), (slice(3, 6), slice(0, 3))):
        across = information[own, other]
        left = information[own, own] - across @ np.linalg.pinv(information[other, other], 1e-6, True) @ across.T
        axes.append(np.linalg.eigh((left + left.T) / 2)[1])
    return axes[0], axes[1]


def _share(values: np.ndarray) -> np.ndarray:
    return np.clip(values, _LEAST, _MOST)
