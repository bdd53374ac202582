"""From the options that verbs share to a method of registration."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kernels.errors import InputError
from tools.cli.options import DEFAULT_EDGE, DEFAULT_MAX_TILT, DEFAULT_YAW_PEAKS
from tools.cli.terminal import say

if TYPE_CHECKING:
    from spectral.registration import SpectralRegistrar
    from spectral.scan import Scan


@dataclass(frozen=True, slots=True)
class Method:
    """How to register, as the options say it.

    Attributes:
        grid: voxels per edge; None for 128.
        voxel: edge of a voxel [m]; None for the one in which the largest scan fits.
        max_tilt: largest roll and pitch between two scans [deg].
        yaw_peaks: how many yaw peaks are followed.
        strength: whether voxels are weighed by their echo strength.
        device: as `choose_device` takes it.
    """

    grid: int | None = None
    voxel: float | None = None
    max_tilt: float = DEFAULT_MAX_TILT
    yaw_peaks: int = DEFAULT_YAW_PEAKS
    strength: bool = False
    device: str | None = None


def build_registrar(scans: "Sequence[Scan]", method: Method) -> "SpectralRegistrar":
    """The spectral registration on the grid that was asked for or that suits the scans.

    Raises:
        InputError, DeviceError: the grid, the scans or the device will not do.
    """
    from kernels.device import choose_device
    from spectral.grid import choose_grid
    from spectral.registration import SpectralConfig, SpectralRegistrar

    if method.strength:
        _look_for_strength(scans)
    config = SpectralConfig(
        max_tilt=float(np.deg2rad(method.max_tilt)), yaw_peaks=method.yaw_peaks, use_strength=method.strength
    )
    grid = choose_grid(scans, method.grid or DEFAULT_EDGE, method.voxel)
    device = choose_device(method.device)
    for note in device.notes:
        say(note)
    return SpectralRegistrar(device, grid, config)


def _look_for_strength(scans: "Sequence[Scan]") -> None:
    bare = [scan.name for scan in scans if scan.strength is None]
    if len(bare) == len(scans):
        raise InputError(
            "--strength: no scan holds echo strengths. Leave it out, or give files with a column intensity or strength."
        )
    if bare:
        say(
            f"{len(bare)} of {len(scans)} scans hold no echo strength and are taken by their shape alone: {bare[0]} ..."
        )
