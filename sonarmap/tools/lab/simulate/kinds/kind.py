"""A pair of scans of some kind with both true poses, and the scenes of the kinds."""

from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.sensing.navigation import Instruments, measure_pose

# Structure of a scene: "flat", hardly any; "weak", low relief or few objects; "rich", in all directions; "twins", rich,
# but looking the same from several sides or places
Relief = Literal["flat", "weak", "rich", "twins"]

# Least and greatest overlaps of pairs, in turns
OVERLAPS = ((0.2, 0.4), (0.4, 0.6), (0.6, 0.9))
# Streams of a pair's seed for the errors of the target's and the source's instruments
_STREAMS = (71, 72)

# Scenes of a kind, in turns: one flat, two weak, five rich, three with twins; an odd number, so that settings that
# alternate with the number of the pair alternate in every scene
LARGE_AND_SMALL = (
    *("flatbed", "floodgate", "seabed", "ship", "bridge", "shallow"),
    *("manifold", "wreck", "harbor", "pool", "clutter"),
)
SMALL = ("pool", "rubble", "shallow", "manifold", "sandflat")
# For sonars that look down: the pool instead of a ship's underside, and the rubble instead of the pool
FROM_ABOVE = tuple({"ship": "pool", "pool": "rubble"}.get(scene, scene) for scene in LARGE_AND_SMALL)


@dataclass(frozen=True, slots=True)
class KindPair:
    """A simulated pair of scans."""

    kind: str  # a key of SCAN_KINDS
    number: int  # of the pair in the set
    seed: int  # of the set
    scene: str  # a key of SCENE_KINDS
    target: Scan  # in its own frame (x forward, y left, z up), without a prior
    source: Scan  # likewise
    T_world_target: RigidTransform  # true pose of the frame; world East-North-Up
    T_world_source: RigidTransform  # likewise
    # overlap, 0..1: share of the points, free of noise and distortion, that have a counterpart in the other scan, the
    # smaller of both directions
    shared: float

    @property
    def relief(self) -> Relief:
        """Relief of the scene."""
        return RELIEF_OF[self.scene]

    @property
    def T_target_source(self) -> RigidTransform:
        """True transform between the frames."""
        return self.T_world_target.inv() * self.T_world_source

    def with_priors(self, instruments: Instruments) -> "KindPair":
        """The pair with measured priors of its poses; their errors depend only on the seed and the number."""
        generators = (np.random.default_rng([self.seed, self.number, stream]) for stream in _STREAMS)
        target, source = (
            replace(scan, prior=measure_pose(pose, instruments, rng))
            for scan, pose, rng in zip(
                (self.target, self.source), (self.T_world_target, self.T_world_source), generators, strict=True
            )
        )
        return replace(self, target=target, source=source)


_SCENES_OF: dict[Relief, tuple[str, ...]] = {
    "flat": ("flatbed", "sandflat"),
    "weak": ("seabed", "shallow"),
    "rich": ("floodgate", "harbor", "wreck", "bridge", "clutter", "rubble"),
    "twins": ("ship", "manifold", "pool"),
}
RELIEF_OF: MappingProxyType[str, Relief] = MappingProxyType(
    {scene: relief for relief, scenes in _SCENES_OF.items() for scene in scenes}
)

ROUGH_SCENES = tuple(scene for scene, relief in RELIEF_OF.items() if relief != "flat")
