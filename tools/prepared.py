"""How many prepared scans a survey's mapper keeps at a time."""

from kernels.opencl.device import Device
from spectral.memory import scans_that_fit

MOST = 8  # loops seldom come back to a scan that was used longer ago


def prepared_scans(device: Device | None, edge: int) -> int:
    """As many as are of use and fit, with one more while the next is prepared.

    Args:
        device: that they are prepared on; None for a method without one.
        edge: voxels per edge of the grid.
    """
    fitting = scans_that_fit(device, edge) - 1 if device else MOST
    return min(MOST, max(2, fitting))
