"""Registration by planes: patches with their covariances, consensus on what corresponds, a closed form.

The method that the paper compares with in Sect. 4.3: Pathak, Birk, Vaskevicius, Poppinga, Fast registration based on
noisy planes with unknown correspondences for 3D mapping, IEEE Transactions on Robotics 26(3), 2010,
DOI 10.1109/TRO.2010.2042989.
"""

from dataclasses import dataclass
from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform

from kernels.errors import InputError
from spectral.result import Registration
from spectral.scan import Scan
from tools.baselines.agreement import REACH, overlap
from tools.baselines.cloud import Cloud, thin
from tools.baselines.conclusion import NO_PEAK
from tools.baselines.planes.consensus import Consensus, Matching
from tools.baselines.planes.extraction import extract_patches
from tools.baselines.planes.patch import Patches
from tools.baselines.planes.verdict import judge, nothing_found

# The paper's bound on roll and pitch between two scans (Sect. 2.7), as the spectral registration has it [rad].
MAX_TILT = float(np.deg2rad(35.0))
_LARGEST_TILT = float(np.deg2rad(85.0))
# The largest patches of a scan, which are the most certain, are matched.
_MOST_PATCHES = 50
# A scan's extent leaves out this share of its points at either end of each axis, which may be stray echoes.
_TRIM = 0.01


@dataclass(frozen=True, slots=True)
class Planes:
    """What a scan contributes to every pair.

    Attributes:
        patches: the largest, in the sensor frame.
        cloud: one point per voxel, to tell how much two scans share.
        extent: diagonal of the box around the points [m].
    """

    patches: Patches
    cloud: Cloud
    extent: float


class PlaneRegistrar:
    """Minimally uncertain maximal consensus of planes (MUMC).

    Only the planes' parameters and covariances decide; the points are asked at the end, for the overlap alone.

    Args:
        voxel: edge of the cells in which planes are grown [m], about as large as the noise or larger.
        max_tilt: largest roll and pitch between two scans [rad].
    """

    def __init__(self, voxel: float, max_tilt: float = MAX_TILT) -> None:
        """Note how to register.

        Raises:
            InputError: a voxel that is no length, a tilt beyond 85 degrees.
        """
        if not (np.isfinite(voxel) and voxel > 0):
            raise InputError(f"voxel is {voxel:g}; wanted an edge length in meters above zero, such as 0.5")
        if not 0 < max_tilt <= _LARGEST_TILT:
            raise InputError(f"max_tilt is {np.rad2deg(max_tilt):g} degrees; wanted above 0 and up to 85 degrees")
        self.voxel, self.max_tilt = voxel, max_tilt

    def prepare(self, scan: Scan) -> Planes:
        """The scan's plane patches; a scan may have none, and its registrations are then refused.

        Raises:
            InputError: the points fill too few voxels.
        """
        cloud = thin(scan, self.voxel)
        patches = extract_patches(scan.points, self.voxel)
        low, high = np.quantile(scan.points, [_TRIM, 1 - _TRIM], axis=0)
        extent = max(float(np.linalg.norm(high - low)), self.voxel)
        return Planes(patches.take(np.arange(min(len(patches), _MOST_PATCHES))), cloud, extent)

    def register(self, target: Planes, source: Planes) -> Registration:
        """Find T_target_source; `accepted` says whether to believe it.

        Without planes that agree the transform is the identity, with the covariance of no knowledge.
        """
        start = perf_counter()
        farthest = max(target.extent, source.extent)
        found: list[Consensus] = []
        if len(target.patches) and len(source.patches):
            found = Matching(target.patches, source.patches, self.voxel, self.max_tilt, farthest).find()
        pose = found[0].pose if found else nothing_found(farthest)
        share = self._overlap(target, source, pose.T_target_source)
        verdict = judge(found, target.patches, source.patches, self.voxel, share)
        return Registration(
            T_target_source=pose.T_target_source,
            covariance=pose.covariance,
            psr=NO_PEAK,
            overlap=share,
            accepted=verdict.accepted,
            seconds=perf_counter() - start,
            reason=verdict.reason,
        )

    def _overlap(self, target: Planes, source: Planes, T_target_source: RigidTransform) -> float:
        return overlap(target.cloud, source.cloud, T_target_source, REACH * self.voxel)
