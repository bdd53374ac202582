"""How much of their surfaces two scans share under a pose: evidence that needs no viewpoint."""

from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.device.device import Array, Device
from sonarmap.kernels.device.readback import Pending
from sonarmap.kernels.surface.shared import Nearness, WeightedElements, shared_sums
from sonarmap.spectral.prepare.surface import Surface

# A point has a counterpart within reach, if the normals there are within 37 degrees of each other [voxels; cosine].
# Where the other scan has a point so near that it covers this one, it shows that place, and should show the point.
_NEARNESS = Nearness(reach=2.0, covered=6.0, alike=0.8)
# A share that is small beside this hardly counts.
_LEAST = 0.05


@dataclass(frozen=True, slots=True)
class SharedSurface:
    """Shares of two scans' surfaces, the mean of both ways, 0..1; all directions of normals count alike."""

    agree: float  # has a counterpart in the other scan, facing the same direction
    covered: float  # lies where the other scan shows something
    # has a point of the other scan within 2 voxels, whatever it faces, each point counting once; the smaller of both
    # ways
    overlap: float

    @property
    def consistency(self) -> float:
        """Of what both should show, what both do, 0..1; a small number where they should show little."""
        return self.agree / (self.covered + _LEAST)


def shared_surfaces(
    device: Device, target: Surface, source: Surface, poses: Array, most: int
) -> Pending[list[SharedSurface]]:
    """Queue what the scans share under each of k poses.

    Args:
        poses: device (k, 16) float32 as `upload_poses` has them, p_target = R p_source + t about the scans' grid
            centers [voxels].
        most: how many points of each scan are looked at.
    """
    ours, theirs = (WeightedElements(surface.elements, surface.direction_weights) for surface in (target, source))
    queued = shared_sums(device, ours, theirs, poses, most, _NEARNESS)

    def read() -> list[SharedSurface]:
        sums = queued.read()
        agree, covered = (sums[:, :, :2] / sums[:, :, 2:3]).mean(axis=1).T
        overlap = sums[:, :, 3].min(axis=1)
        return [SharedSurface(*shares) for shares in np.column_stack([agree, covered, overlap]).tolist()]

    return Pending(read)
