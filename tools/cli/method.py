"""From the options that verbs share to a method of registration."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tools.cli.options import DEFAULT_EDGE

if TYPE_CHECKING:
    from spectral.registration import SpectralRegistrar
    from spectral.scan import Scan


def build_registrar(
    scans: "Sequence[Scan]",
    grid: int | None,
    voxel: float | None,
    max_tilt: float,
    device: str | None,
    yaw_peaks: int = 6,
) -> "SpectralRegistrar":
    """The spectral registration on the grid that was asked for or that suits the scans.

    Args:
        scans: what will be registered.
        grid: voxels per edge; None for 128.
        voxel: edge of a voxel [m]; None for the one in which the largest scan fits.
        max_tilt: largest roll and pitch between two scans [deg].
        device: as `choose_device` takes it.
        yaw_peaks: how many yaw peaks are followed.

    Raises:
        InputError, DeviceError: the grid, the scans or the device will not do.
    """
    from kernels.device import choose_device
    from spectral.grid import choose_grid
    from spectral.registration import SpectralConfig, SpectralRegistrar

    config = SpectralConfig(max_tilt=float(np.deg2rad(max_tilt)), yaw_peaks=yaw_peaks)
    chosen = choose_grid(scans, grid or DEFAULT_EDGE, voxel)
    return SpectralRegistrar(choose_device(device), chosen, config)
