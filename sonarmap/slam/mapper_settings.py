"""Settings of the mapper."""

from dataclasses import dataclass, field

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.slam.candidates.settings import LoopSettings
from sonarmap.slam.map.doubtful_points import MIN_SEEN
from sonarmap.slam.motion.limits import MotionLimits
from sonarmap.slam.stream.keys import KeySettings


@dataclass(frozen=True, slots=True)
class MapperSettings:
    """Settings of the mapper.

    Attributes:
        loops: which extra pairs are tried and kept.
        limits: what the vehicle's motion cannot exceed.
        keys: how key scans of a dense stream are chosen.
        bridge: over a gap, pairs up to this many scans apart are tried; 1 tries none.
        prepared: number of prepared scans kept at a time, each of which holds device memory; None for as many as are
            useful and fit.
        map_voxel: edge of the fused map's voxels [m]; None is the survey's voxel.
        min_seen: points that fewer scans saw are left out of the map where others contradict them, see
            `slam.map.doubtful_points`; 1 leaves out none.
        straighten: whether to correct scans whose points have times for the sensor's motion, if they then fit better.
    """

    loops: LoopSettings = field(default_factory=LoopSettings)
    limits: MotionLimits = field(default_factory=MotionLimits)
    keys: KeySettings = field(default_factory=KeySettings)
    bridge: int = 3
    prepared: int | None = None
    map_voxel: float | None = None
    min_seen: int = MIN_SEEN
    straighten: bool = True

    def __post_init__(self) -> None:
        if self.bridge < 1:
            raise InputError(f"`bridge={self.bridge}`: wanted at least 1")
        if self.prepared is not None and self.prepared < 2:
            raise InputError(f"`prepared={self.prepared}`: wanted at least 2")
        if self.map_voxel is not None and not (np.isfinite(self.map_voxel) and self.map_voxel > 0):
            raise InputError(f"the map's voxel is {self.map_voxel} m; wanted a positive length")
        if self.min_seen < 1:
            raise InputError(f"`min_seen={self.min_seen}`: wanted at least 1, which leaves no point out")
