"""A pair of scans of some kind, the truth of both poses, and the scenes that kinds are seen in."""

from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.simulate.sensing.navigation import Instruments, measure_pose

# Structure of a scene: "flat", hardly any; "weak", low relief or few objects; "rich", in all directions; "twins", rich,
# but looking the same from several sides or places
Relief = Literal["flat", "weak", "rich", "twins"]

# Shares of the points in common between which pairs are drawn, in turns
OVERLAPS = ((0.2, 0.4), (0.4, 0.6), (0.6, 0.9))
# Streams of a pair's seed for the errors of the target's and the source's instruments
_STREAMS = (71, 72)

# Scenes of a kind, in turns: one flat, two weak, five rich, three with twins; an odd number, so that what alternates
# with the pairs' numbers does so over every scene
LARGE_AND_SMALL = (
    *("flatbed", "floodgate", "seabed", "ship", "bridge", "shallow"),
    *("manifold", "wreck", "harbor", "pool", "clutter"),
)
SMALL = ("pool", "rubble", "shallow", "manifold", "sandflat")
# For what looks down: the pool, not a ship's underside, and rubble in its place
FROM_ABOVE = tuple({"ship": "pool", "pool": "rubble"}.get(scene, scene) for scene in LARGE_AND_SMALL)


@dataclass(frozen=True, slots=True)
class KindPair:
    """One simulated pair."""

    kind: str  # a key of SCAN_KINDS
    number: int  # which of the set
    seed: int  # which set
    scene: str  # a key of SCENE_KINDS
    target: Scan  # in its own frame (x forward, y left, z up), without a prior
    source: Scan  # likewise
    T_world_target: RigidTransform  # where the frame truly was; world East-North-Up
    T_world_source: RigidTransform  # likewise
    # share of the points, free of noise and distortion, that have a counterpart in the other scan, 0..1; the smaller of
    # both ways
    shared: float

    @property
    def relief(self) -> Relief:
        """Of the scene."""
        return relief_of(self.scene)

    @property
    def T_target_source(self) -> RigidTransform:
        """The truth."""
        return self.T_world_target.inv() * self.T_world_source

    def with_priors(self, instruments: Instruments) -> "KindPair":
        """The same pair with what instruments measure of its poses; the errors depend on seed and number alone."""
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


def relief_of(scene: str) -> Relief:
    """The relief of a scene of SCENE_KINDS. Raises InputError: a scene that has no row here."""
    if scene not in RELIEF_OF:
        raise InputError(f"no relief is known of the scene {scene!r}; give it a row in `RELIEF_OF`")
    return RELIEF_OF[scene]
