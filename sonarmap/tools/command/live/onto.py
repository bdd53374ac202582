# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""A finished map as key scans, in which a dive finds its place."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.locate.surveyed_map import LEAST
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.command.live.kept_keys import KeptKey
from sonarmap.tools.files.map_folder.folder import Map, surveyed_map
from sonarmap.tools.files.readers.incoming import Mark


def map_keys(folder: Map) -> Iterator[KeptKey]:
    """Key scans of the largest part of a map, which is taken to be sure of their poses: it stays as it is.

    Raises:
        InputError: no pose of it has enough points.
    """
    surveyed, part, before = surveyed_map(folder), folder.parts[0], None
    for key in surveyed.apart:
        T, stamp, name = surveyed.T_map_sensor[key], float(part.trajectory.stamps[key]), folder.names[part.scans[key]]
        prior = PosePrior(T, LEAST.copy()) if before is None else None
        scan = replace(surveyed.key_scan(key), stamp=stamp, prior=prior, name=f"map:{name}")
        yield KeptKey(scan, None if before is None else _step(before.inv() * T), Mark(), folder.voxel)
        before = T


def _step(T: RigidTransform) -> Registration:
    """As the map has it."""
    return Registration(T, np.diag(LEAST**2), psr=np.inf, overlap=1.0, accepted=True, seconds=0.0, reason="of the map")
