"""Key scans on disk, from which a killed mapping goes on; and a finished map as key scans."""

import json
import shutil
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.execute.pair_text import from_text, to_text
from sonarmap.slam.locate.surveyed_map import LEAST
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior, Scan
from sonarmap.tools.files.map_folder.folder import Map, surveyed_map
from sonarmap.tools.files.readers.clouds.cloud import refuse_map_coordinates
from sonarmap.tools.files.readers.incoming import Mark
from sonarmap.tools.files.writers.atomic import atomic_path, locked, require_writable
from sonarmap.tools.methods.fingerprint import fingerprint

FOLDER = "live"  # within the map's folder
_INPUTS = "inputs.sha256"


@dataclass(frozen=True, slots=True)
class KeptKey:
    """A key scan as it is stored."""

    scan: Scan
    step: Registration | None  # registration to the previous key scan; None for the first of a part
    behind: Mark  # where reading of the input goes on
    voxel: float  # edge of the survey's voxels [m]


def keep_key(out: Path, number: int, key: KeptKey) -> None:
    """Write a key scan to a map's folder; it becomes the last one."""
    prior = key.scan.prior
    fields: dict[str, Any] = {
        "name": key.scan.name,
        "stamp": key.scan.stamp,
        "step": None if key.step is None else to_text(key.step),
        "behind": asdict(key.behind),
        "voxel": key.voxel,
        "prior": prior and [prior.T_world_sensor.as_matrix().tolist(), prior.sigmas.tolist()],
    }
    (out / FOLDER / _name(number + 1)).unlink(missing_ok=True)  # left from before this one was damaged
    with atomic_path(out / FOLDER / _name(number)) as temporary, temporary.open("wb") as file:
        np.savez(file, points=key.scan.points, said=np.frombuffer(json.dumps(fields).encode(), np.uint8))


def kept_keys(out: Path, alert: Callable[[str], object] = len) -> Iterator[KeptKey]:
    """The key scans of a map's folder, up to the first that is missing or damaged; `alert` reports a damaged one."""
    number = 0
    while (path := out / FOLDER / _name(number)).is_file():
        try:
            with np.load(path, allow_pickle=False) as arrays:
                fields, points = json.loads(arrays["said"].tobytes()), arrays["points"]
            step = None if fields["step"] is None else from_text(fields["step"])[0]
            prior = fields["prior"] and PosePrior(
                RigidTransform.from_matrix(np.array(fields["prior"][0])), np.array(fields["prior"][1], np.float64)
            )
            refuse_map_coordinates(points)
            scan = Scan(points, stamp=float(fields["stamp"]), prior=prior, name=str(fields["name"]))
            behind, voxel = Mark(**fields["behind"]), float(fields["voxel"])
            types = type(behind.file), type(behind.count), type(behind.shots)
            if types != (str, int, int) or not (voxel > 0 and isfinite(scan.stamp + voxel)):
                raise ValueError
            key = KeptKey(scan, step, behind, voxel)
        except Exception:  # noqa: BLE001 - a damaged file can raise anything
            alert(f"{path} is damaged and left out; what it held is mapped again")
            return
        yield key
        number += 1


def has_keys(out: Path) -> bool:
    """Whether there are key scans of the dive itself, not only of a finished map."""
    return any(key.behind != Mark() for key in kept_keys(out))


def forget_keys(out: Path) -> None:
    """Delete all key scans and the chosen remedies, but not their folder, which programs lock."""
    for path in [*(out / FOLDER).glob("key_*.npz"), *(out / FOLDER).glob("*.json")]:
        path.unlink(missing_ok=True)


def forget_dive(out: Path) -> None:
    """Delete the key scans of the dive itself, not those of a finished map."""
    for number, key in enumerate(list(kept_keys(out))):
        if key.behind != Mark():
            (out / FOLDER / _name(number)).unlink()


def clear(out: Path) -> None:
    """Delete the folder of key scans at the end of a dive."""
    shutil.rmtree(out / FOLDER, ignore_errors=True)


@contextmanager
def kept_for(out: Path, inputs: Sequence[str], settings: object = None) -> Generator[None]:
    """Lock a map's folder within the block, and delete key scans of other inputs or settings (any value that
    `fingerprint` accepts)."""
    folder = out / FOLDER
    require_writable(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with locked(folder, writing=True):
        digest = fingerprint([[str(Path(name).resolve()) for name in inputs], settings])
        try:
            same = (folder / _INPUTS).read_text(encoding="utf-8") == digest
        except (OSError, ValueError):
            same = False
        if not same:
            forget_keys(out)
            with atomic_path(folder / _INPUTS) as temporary:
                temporary.write_text(digest, encoding="utf-8")
        yield


def _name(number: int) -> str:
    return f"key_{number:05d}.npz"


def map_keys(folder: Map) -> Iterator[KeptKey]:
    """Key scans of the largest part of a map, with its poses as almost exact, so that it stays as it is."""
    surveyed, part, before = surveyed_map(folder), folder.parts[0], None
    for key in surveyed.apart:
        T, stamp, name = surveyed.T_map_sensor[key], float(part.trajectory.stamps[key]), folder.names[part.scans[key]]
        prior = PosePrior(T, LEAST.copy()) if before is None else None
        scan = replace(surveyed.key_scan(key), stamp=stamp, prior=prior, name=f"map:{name}")
        yield KeptKey(scan, None if before is None else _step(before.inv() * T), Mark(), folder.voxel)
        before = T


def _step(T: RigidTransform) -> Registration:
    """A step between key scans with almost exact relative pose T."""
    return Registration(T, np.diag(LEAST**2), psr=np.inf, overlap=1.0, accepted=True, seconds=0.0, reason="of the map")
