"""Registration by planes: patches with their covariances, consensus on what corresponds, a closed form.

The method that the paper compares with in Sect. 4.3: Pathak, Birk, Vaskevicius, Poppinga, Fast registration based on
noisy planes with unknown correspondences for 3D mapping, IEEE Transactions on Robotics 26(3), 2010,
DOI 10.1109/TRO.2010.2042989.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.baselines.cloud import ThinnedCloud, thin
from sonarmap.tools.lab.baselines.planes.extraction import extract_patches
from sonarmap.tools.lab.baselines.planes.fit import Patches
from sonarmap.tools.lab.baselines.planes.matching import Consensus, Matching
from sonarmap.tools.lab.baselines.planes.pose import LOOSE_ROTATION, PlanePose, fixed_and_open
from sonarmap.tools.lab.baselines.result import NO_PEAK, REACH, MethodVerdict, overlap, verdict

# The paper's bound on roll and pitch between two scans (Sect. 2.7), as the spectral registration has it [rad].
MAX_TILT = float(np.deg2rad(35.0))
_LARGEST_TILT = float(np.deg2rad(85.0))
# The largest patches of a scan, which are the most certain, are matched.
_MOST_PATCHES = 50
# A scan's extent leaves out this share of its points at either end of each axis, which may be stray echoes.
_TRIM = 0.01
# The largest standard deviations with which a transform is believed: of a turn [rad], of a shift [voxels].
LARGEST_TURN = float(np.deg2rad(3.0))
LARGEST_SHIFT = 3.0
# Chance brings a few planes together: so many more than any other answer must agree, as a ratio, and at least so many.
LEAST_DISTINCTION = 1.25
FEWEST_PLANES = 5
LEAST_AREA = 0.15
LEAST_OVERLAP = 0.1
# Answers nearer than this to each other are one [rad; voxels].
_SAME_ROTATION = float(np.deg2rad(10.0))
_SAME_SHIFT = 6.0


@dataclass(frozen=True, slots=True)
class Planes:
    """What a scan contributes to every pair."""

    patches: Patches  # the largest, in the sensor frame
    cloud: ThinnedCloud  # one point per voxel, to tell how much two scans share
    extent: float  # diagonal of the box around the points [m]


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
        sets: list[Consensus] = []
        if len(target.patches) and len(source.patches):
            sets = Matching(target.patches, source.patches, self.voxel, self.max_tilt, farthest).find()
        nothing = np.diag([LOOSE_ROTATION**2] * 3 + [farthest**2] * 3)
        pose = sets[0].pose if sets else PlanePose(RigidTransform.identity(), nothing)
        share = overlap(target.cloud, source.cloud, pose.T_target_source, REACH * self.voxel)
        belief = judge(sets, target.patches, source.patches, self.voxel, share)
        return Registration(
            T_target_source=pose.T_target_source,
            covariance=pose.covariance,
            psr=NO_PEAK,
            overlap=share,
            accepted=belief.accepted,
            seconds=perf_counter() - start,
            reason=belief.reason,
        )


def judge(sets: Sequence[Consensus], target: Patches, source: Patches, voxel: float, overlap: float) -> MethodVerdict:
    """Whether to believe the first of the sets, best first, and the reason in words."""
    if not sets:
        return MethodVerdict(False, f"no two of {len(target)} and {len(source)} planes agree on a transform")
    best = sets[0]
    open_ways = _open_ways(target.take(best.target), best.pose, voxel)
    if open_ways:
        return MethodVerdict(False, f"{len(best)} planes agree, and {open_ways}")
    rival = max((len(rival_set) for rival_set in sets[1:] if _differ(best, rival_set, voxel)), default=0)
    area = best.area / min(target.area.sum(), source.area.sum())
    return verdict(
        f"{len(best)} planes agree, of the next answer {rival}; they are {area:.0%} of the planes' area; "
        f"{overlap:.0%} of the points are shared",
        (len(best) >= FEWEST_PLANES, f"{FEWEST_PLANES} planes"),
        (len(best) >= LEAST_DISTINCTION * rival, f"{LEAST_DISTINCTION:g} times as many"),
        (area >= LEAST_AREA, f"{LEAST_AREA:.0%} of the area"),
        (overlap >= LEAST_OVERLAP, f"{LEAST_OVERLAP:.0%} of the points"),
    )


def _open_ways(planes: Patches, pose: PlanePose, voxel: float) -> str:
    """What the planes leave open, in words; "" where nothing."""
    undetermined = {1: "one direction is", 2: "two directions and a turn are"}.get(
        len(fixed_and_open(planes.normal)[1])
    )
    if undetermined:
        return f"no three of them span space: {undetermined} taken from where the patches lie"
    turn = float(np.sqrt(np.linalg.eigvalsh(pose.covariance[:3, :3])[-1]))
    shift = float(np.sqrt(np.linalg.eigvalsh(pose.covariance[3:, 3:])[-1]))
    if turn > LARGEST_TURN or shift > LARGEST_SHIFT * voxel:
        return (
            f"fix it to {np.rad2deg(turn):.1f} degrees and {shift:.1f} m only (one standard deviation); believed up to "
            f"{np.rad2deg(LARGEST_TURN):g} degrees and {LARGEST_SHIFT * voxel:.1f} m"
        )
    return ""


def _differ(a: Consensus, b: Consensus, voxel: float) -> bool:
    """Whether two answers are different, and not one found twice."""
    apart = a.pose.T_target_source.inv() * b.pose.T_target_source
    turned = apart.rotation.magnitude() > _SAME_ROTATION
    return bool(turned or np.linalg.norm(apart.translation) > _SAME_SHIFT * voxel)
