"""Every method on the pairs of real scans with ground truth in folders, with and without priors."""

import hashlib
import math
import re
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import choose_grid
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.file import FORMATS
from sonarmap.tools.files.readers.instruments import PRIORS
from sonarmap.tools.files.readers.navigation.priors import navigate
from sonarmap.tools.files.readers.scans import read_scan
from sonarmap.tools.files.readers.selection import natural_key
from sonarmap.tools.files.readers.trajectory import GT_LOG, TruePair, read_gt_log
from sonarmap.tools.lab.reproduce.experiments import Experiment, Outcome, Request, Value, all_seeds, as_asked
from sonarmap.tools.lab.reproduce.registrations import answer, compared_methods, registrar, scores
from sonarmap.tools.lab.simulate.sensing.navigation import KINDS, Instruments, instruments_for, measure_pose
from sonarmap.tools.methods.registry import find_method

_NUMBERED = re.compile(r"(?:.*\D)?(\d{1,9})", re.ASCII | re.DOTALL)


@dataclass(frozen=True, slots=True)
class RealPair:
    """Two files of scans, and the true transform between them."""

    name: str  # numbers of target and source, as 0-2
    target: Path
    source: Path
    T_target_source: RigidTransform  # the truth


@dataclass(frozen=True, slots=True)
class RealSet:
    """The pairs of one folder."""

    name: str  # of the folder
    pairs: tuple[RealPair, ...]  # in the order of gt.log
    priors: Path | None  # the folder's priors.csv, or None
    digest: str  # of the content of all files that affect the rows, 64 hexadecimal digits

    @property
    def key(self) -> str:
        """The name, and enough of the digest to distinguish contents."""
        return f"{self.name}@{self.digest[:8]}"


def read_sets(folder: Path) -> tuple[RealSet, ...]:
    """The set in `folder` if it has a gt.log, otherwise those of its sub-folders with a gt.log, in natural order.

    Raises InputError: the folder does not exist, a gt.log is missing or invalid, or a scan that it names has no file.
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
    """The names of the sub-folders that `read_sets` ignores, as they have no gt.log."""
    if (folder / GT_LOG).is_file():
        return ()
    inside = [path for path in folder.iterdir() if path.is_dir() and not path.name.startswith(".")]
    return tuple(sorted(path.name for path in inside if not (path / GT_LOG).is_file()))


def _read_set(folder: Path) -> RealSet:
    path = folder / GT_LOG
    name = folder.name if folder.name.strip(".") else folder.resolve().name  # a link keeps its own name
    numbered = _numbered_scans(folder)
    pairs = []
    for truth in read_gt_log(path):
        target, source = (_file_of(numbered, number, truth, path) for number in (truth.i, truth.j))
        pairs.append(RealPair(f"{truth.i}-{truth.j}", target, source, truth.T_i_j))
    scans = sorted({scan for pair in pairs for scan in (pair.target, pair.source)})
    priors = folder / PRIORS
    beside = [priors] if priors.is_file() else []
    return RealSet(name, tuple(pairs), next(iter(beside), None), _digest([path, *scans, *beside]))


def _numbered_scans(folder: Path) -> dict[int, list[Path]]:
    """Scan files by the number at the end of their names, which is 7 for 7.npy and cloud_bin_7.ply."""
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


# Standard deviations of the measurements that --known draws [rad, rad, m, m]
SIGMAS = {"attitude": math.radians(1.5), "heading": math.radians(3.0), "depth": 0.15, "position": 3.0}
_USUAL = {
    "edge": 128,  # voxels per edge
    "voxel": None,  # edge of a voxel [m]; None: chosen for each pair
    "max_tilt": 35.0,  # largest roll and pitch between two scans, for the methods that bound them [degrees]
    "seeds": 5,  # number of draws of the measurements of `known` for each pair
    "first_seed": 0,
    "first_only": False,  # whether to use only the first pair of each set
}
SOURCES = (
    *(f"tools/{folder}" for folder in ("files/readers", "lab/evaluate")),
    *(f"tools/lab/reproduce/{name}.py" for name in ("registrations", "real")),
    *("tools/lab/simulate/sensing/navigation.py", "spectral/grid.py"),
)
NOTHING, FILE = "nothing", "priors.csv"
_TARGET_STREAM, _SOURCE_STREAM = 81, 82


def create(request: Request) -> Experiment:
    """A job is a pair by one method with some priors, as kitchen@1f0c.../0-2/nothing/spectral.

    The digest of a set and the drawn priors are part of a job's key, so a new set does not cause jobs of other sets to
    be run again. `quick` registers the first pair of every set on grids of half the edge.
    """
    sets = read_sets(request.chosen_folder)
    usual = {
        **_USUAL,
        **compared_methods(request),
        "known": _known(request),
        "sets": {real_set.name: real_set.digest for real_set in sets},
        "without_truth": without_truth(request.chosen_folder),
    }
    settings = as_asked(request, usual, {"edge": 64, "seeds": 1, "first_only": True})
    # seeds of the drawn measurements, by the part of the key that names them
    draws = {f"{','.join(settings.known)},seed={seed}": seed for seed in all_seeds(settings)} if settings.known else {}
    jobs = {
        f"{real_set.key}/{pair.name}/{known}/{method}": (real_set, pair, known, method)
        for real_set in sets
        for pair in (real_set.pairs[:1] if settings.first_only else real_set.pairs)
        for known in (NOTHING, *([FILE] if real_set.priors else []), *draws)
        for method in settings.methods
        if known == NOTHING or "priors" in find_method(method).options
    }
    read = lru_cache(maxsize=1)(lambda target, source: (read_scan(target), read_scan(source)))  # for the next method

    def run(job: str) -> Outcome:
        """Register a pair by one method; its time includes the preparation of both scans."""
        real_set, pair, known, method = jobs[job]
        scans = read(pair.target, pair.source)
        grid = choose_grid(scans, settings.edge, settings.voxel)
        built = registrar(method, grid, request.opened.selector, math.radians(settings.max_tilt))
        if known in draws:
            scans = _measured(scans, real_set, pair, draws[known], settings.known)
        elif known == FILE and real_set.priors is not None:
            scans = navigate(scans, real_set.priors, allow_unknown=True).scans
        registration, seconds = answer(built, *scans)
        cells: dict[str, Value] = {
            "set": real_set.name,
            "pair": pair.name,
            "known": ", ".join(settings.known) if known in draws else known,
            "draw": str(draws.get(known, "")),
            "method": method,
        }
        scored = scores(registration, pair.T_target_source, grid.voxel)
        return Outcome((cells | {"voxel_m": grid.voxel} | scored,), (cells | {"seconds": seconds},))

    return Experiment("real", settings, tuple(jobs), run, SOURCES, settings.methods, ("edge", "voxel", "max_tilt"))


def _measured(scans: Sequence[Scan], real_set: RealSet, pair: RealPair, seed: int, known: Sequence[str]) -> list[Scan]:
    """The scans with priors: simulated measurements of the true poses by the `known` instruments."""
    instruments = Instruments(**{kind: SIGMAS[kind] if kind in known else math.inf for kind in KINDS})
    poses = RigidTransform.identity(), pair.T_target_source  # the world is the target's frame
    entropy = [seed, zlib.crc32(f"{real_set.name}/{pair.name}".encode())]
    return [
        replace(scan, prior=measure_pose(pose, instruments, np.random.default_rng([*entropy, stream])))
        for scan, pose, stream in zip(scans, poses, (_TARGET_STREAM, _SOURCE_STREAM), strict=True)
    ]


def _known(request: Request) -> tuple[str, ...]:
    """The instruments of KINDS with simulated measurements."""
    unused = [name for name in ("seeds", "seed") if request.known is None and name in request.given]
    if unused:
        raise InputError(f"--{unused[0]} has no effect without --known; give --known too, or leave it out")
    known = () if request.known is None else request.known.split(",")
    if known:
        instruments_for(known)  # raises InputError for unknown ones
    return tuple(kind for kind in KINDS if kind in known)
