# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
"""A finished map as key scans, in which a dive finds its place: what a sensor would see of the map where one was."""

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior, Scan
from sonarmap.tools.command.live.kept_keys import KeptKey
from sonarmap.tools.files.map_folder.folder import MapFolder, MapPart
from sonarmap.tools.files.readers.incoming import Mark

_APART = 8.0  # [voxels], about as far as key scans are apart
_TURNED = np.radians(15.0)
_FEWEST = 50  # points of a scan's own
_MOST = 0.95  # share of these that are within its reach, and its field of view
_SURE = np.repeat([1e-3, 1e-2], 3)  # how well the map is taken to know its poses beside each other [rad, m]


def map_keys(folder: MapFolder) -> Iterator[KeptKey]:
    """Key scans of the largest part of a map.

    Raises:
        InputError: no pose of it has enough points.
    """
    part, before = folder.parts[0], None
    for k, scan in enumerate(part.scans):
        T = part.trajectory.T_world_sensor[k]
        if before is not None and not _is_apart(before.inv() * T, folder.voxel):
            continue
        if (points := _seen_from(part, scan, T)) is None:
            continue
        step = None if before is None else _step(before.inv() * T)
        prior = PosePrior(T, _SURE.copy()) if before is None else None
        stamp = float(part.trajectory.stamps[k])
        yield KeptKey(
            Scan(points, stamp=stamp, prior=prior, name=f"map:{folder.names[scan]}"), step, Mark(), folder.voxel
        )
        before = T
    if before is None:
        raise InputError(
            f"{folder.path}: no scan has {_FEWEST} points of its own in the map; nothing to find a place by"
        )


def _is_apart(T: RigidTransform, voxel: float) -> bool:
    return bool(np.linalg.norm(T.translation) > _APART * voxel or T.rotation.magnitude() > _TURNED)


def _seen_from(part: MapPart, scan: int, T_world_sensor: RigidTransform) -> np.ndarray | None:
    """(N, 3) float32 [m, sensor frame]: the map's points where those lie that are mostly of this scan; None where these
    are few."""
    points = T_world_sensor.inv().apply(part.points)
    own = points[part.columns["scan"] == scan]
    if len(own) < _FEWEST:
        return None
    far, middle = np.linalg.norm(points, axis=1), own.mean(axis=0) / np.linalg.norm(own.mean(axis=0))
    reach = np.quantile(np.linalg.norm(own, axis=1), _MOST)
    view = np.quantile(own @ middle / np.maximum(np.linalg.norm(own, axis=1), 1e-9), 1 - _MOST)
    return points[(far <= reach) & (points @ middle >= view * far)].astype(np.float32)


def _step(T: RigidTransform) -> Registration:
    """As the map has it."""
    return Registration(T, np.diag(_SURE**2), psr=np.inf, overlap=1.0, accepted=True, seconds=0.0, reason="of the map")
