"""Folders of numbered scans with the truth between them: which pairs there are, in which files."""

import hashlib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.file import FORMATS, TRAJECTORY
from sonarmap.tools.files.readers.instruments import PRIORS
from sonarmap.tools.files.readers.poses.trajectory import GT_LOG, TruePair, read_gt_log
from sonarmap.tools.files.readers.selection import natural_key

_NUMBERED = re.compile(r"(?:.*\D)?(\d{1,9})", re.ASCII | re.DOTALL)


@dataclass(frozen=True, slots=True)
class RealPair:
    """Two files, and the truth between their scans."""

    name: str  # the numbers of target and source, as in 0-2
    # target, source: the files
    target: Path
    source: Path
    T_target_source: RigidTransform  # the truth


@dataclass(frozen=True, slots=True)
class RealSet:
    """The pairs of one folder."""

    name: str  # the folder's
    pairs: tuple[RealPair, ...]  # in the order of gt.log
    priors: Path | None  # the folder's priors.csv, or None
    digest: str  # of the content of all files that decide the rows, 64 hexadecimal digits

    @property
    def key(self) -> str:
        """The name, and as much of the digest as tells this content from any other."""
        return f"{self.name}@{self.digest[:8]}"


def read_sets(folder: Path) -> tuple[RealSet, ...]:
    """The set in `folder` if it has a gt.log, otherwise those in its sub-folders that have one, in natural order.

    Raises:
        InputError: there is no folder, no gt.log, or one that cannot be used; or a scan that it names has no file.
    """
    if not folder.is_dir():
        raise InputError(f"there is no folder {folder}; give one that holds scans and a {GT_LOG}")
    if (folder / GT_LOG).is_file():
        return (_read_set(folder),)
    try:
        inside = sorted(
            (path for path in folder.iterdir() if (path / GT_LOG).is_file()), key=lambda path: natural_key(path.name)
        )
    except OSError as error:
        raise InputError(f"cannot read {folder}: {error.strerror or error}; check its permissions") from error
    if not inside:
        raise InputError(
            f"neither {folder} nor a folder in it has a {GT_LOG}; wanted for every pair a line with the numbers of two "
            "scans, as 0 1, then the four rows of the matrix that maps points of the second into the first"
        )
    return tuple(_read_set(path) for path in inside)


def without_truth(folder: Path) -> tuple[str, ...]:
    """The names of the folders in `folder` that `read_sets` leaves out, as they have no gt.log."""
    if (folder / GT_LOG).is_file():
        return ()
    inside = [path for path in folder.iterdir() if path.is_dir() and not path.name.startswith(".")]
    return tuple(sorted(path.name for path in inside if not (path / GT_LOG).is_file()))


def _read_set(folder: Path) -> RealSet:
    path = folder / GT_LOG
    name = folder.name if folder.name.strip(".") else folder.resolve().name  # of a link its own, of . the folder's
    numbered = _numbered_scans(folder)
    pairs = []
    for truth in read_gt_log(path):
        target, source = (_file_of(numbered, number, truth, path) for number in (truth.i, truth.j))
        pairs.append(RealPair(f"{truth.i}-{truth.j}", target, source, truth.T_i_j))
    scans = sorted({scan for pair in pairs for scan in (pair.target, pair.source)})
    priors = folder / PRIORS
    beside = [priors, *(scan.with_suffix(TRAJECTORY) for scan in scans)]
    digest = _digest([path, *scans, *(other for other in beside if other.is_file())])
    return RealSet(name, tuple(pairs), priors if priors.is_file() else None, digest)


def _numbered_scans(folder: Path) -> dict[int, list[Path]]:
    """The scans whose names end in a number, by this number: 7.npy and cloud_bin_7.ply have 7."""
    numbered: dict[int, list[Path]] = {}
    for path in sorted(folder.iterdir()):
        match = _NUMBERED.fullmatch(path.stem)
        if match and path.suffix.lower() in FORMATS and not path.name.startswith(".") and path.is_file():
            numbered.setdefault(int(match[1]), []).append(path)
    return numbered


def _file_of(numbered: dict[int, list[Path]], number: int, truth: TruePair, path: Path) -> Path:
    files = numbered.get(number, [])
    if len(files) == 1:
        return files[0]
    where = f"{path}: line {truth.line} names the scan {number}"
    if not files:
        raise InputError(
            f"{where}, and no scan beside it has a name that ends in this number, as {number}.ply or "
            f"cloud_bin_{number}.ply; known formats are {', '.join(FORMATS)}. Add the file, or delete the pair"
        )
    raise InputError(
        f"{where}, and the names of {len(files)} scans end in it: {files[0].name} and {files[1].name}; move one away"
    )


def _digest(files: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for path in files:
        try:
            content = path.read_bytes()
        except OSError as error:
            raise InputError(f"cannot read {path}: {error.strerror or error}; check its permissions") from error
        digest.update(f"{path.name}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()
