"""Every pair of folders of real scans with known truth, by every method, with the priors that there are and without."""

import math
import zlib
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.grid import Grid, choose_grid
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.navigation.priors import navigate
from sonarmap.tools.files.readers.scans import read_scan
from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome, all_seeds
from sonarmap.tools.lab.reproduce.experiments import Request, as_asked
from sonarmap.tools.lab.reproduce.real_set import RealPair, RealSet, read_sets, without_truth
from sonarmap.tools.lab.reproduce.registrations import (
    answer,
    claims,
    compared_methods,
    errors,
    finish_device,
    registrar,
)
from sonarmap.tools.lab.simulate.sensing.navigation import KINDS, Instruments, instruments_for, measure_pose
from sonarmap.tools.methods.registry import find_method

# Standard deviations of what --known draws [rad, rad, m, m]
SIGMAS = {"attitude": math.radians(1.5), "heading": math.radians(3.0), "depth": 0.15, "position": 3.0}
# Voxels per edge, and their size [m], None to choose it for each pair; the largest roll and pitch between two scans, of
# the methods that bound them [degrees]; how often the measurements of `known` are drawn for each pair
_USUAL = {"edge": 128, "voxel": None, "max_tilt": 35.0, "seeds": 5, "first_seed": 0, "first_only": False}
SOURCES = (
    *(f"tools/{folder}" for folder in ("files/readers", "lab/evaluate")),
    *(f"tools/lab/reproduce/{name}.py" for name in ("experiment", "registrations", "real", "real_set")),
    *("tools/lab/simulate/sensing/navigation.py", "spectral/grid.py"),
)
NOTHING, FILE = "nothing", "priors.csv"
_TARGET_STREAM, _SOURCE_STREAM = 81, 82


def create(request: Request) -> Experiment:
    """A job is a pair, what is known beforehand, and a method, as in kitchen@1f0c.../0-2/nothing/spectral.

    The digest of a set and the drawn priors are part of a job's key: another set makes no job run again. `quick` is the
    first pair of every set on half the voxels.
    """
    sets = {real_set.key: real_set for real_set in read_sets(request.chosen_folder)}
    usual = _USUAL | compared_methods(request) | {"known": _known(request)}
    # pyrefly: ignore[unsupported-operation]
    usual["sets"] = {real_set.name: real_set.digest for real_set in sets.values()}
    usual["without_truth"] = without_truth(request.chosen_folder)
    settings = as_asked(request, usual, {"edge": 64, "seeds": 1, "first_only": True})
    # seeds of the drawn measurements, by all that decides those of a pair in a word
    draws = {f"{','.join(settings.known)},seed={seed}": seed for seed in all_seeds(settings)} if settings.known else {}
    instruments = Instruments(**{kind: SIGMAS[kind] if kind in settings.known else math.inf for kind in KINDS})

    @lru_cache(maxsize=1)
    def scans_of(target: Path, source: Path) -> tuple[Scan, Scan, Grid]:
        """The scans of a pair, and the grid for them."""
        scans = read_scan(target), read_scan(source)
        return *scans, choose_grid(scans, settings.edge, settings.voxel)

    def with_priors(scans: Sequence[Scan], real_set: RealSet, pair: RealPair, known: str) -> Sequence[Scan]:
        """The scans with what is known of them: a row of the file, or measurements drawn about the truth."""
        if known == NOTHING:
            return scans
        if known == FILE and real_set.priors is not None:
            return navigate(scans, real_set.priors, allow_unknown=True).scans
        poses = RigidTransform.identity(), pair.T_target_source  # the world is the target's frame
        entropy = [draws[known], zlib.crc32(f"{real_set.name}/{pair.name}".encode())]
        return [
            replace(scan, prior=measure_pose(pose, instruments, np.random.default_rng([*entropy, stream])))
            for scan, pose, stream in zip(scans, poses, (_TARGET_STREAM, _SOURCE_STREAM), strict=True)
        ]

    def run(job: str) -> Outcome:
        key, pair_name, known, method = job.split("/")
        real_set = sets[key]
        pair = next(pair for pair in real_set.pairs if pair.name == pair_name)
        *scans, grid = scans_of(pair.target, pair.source)
        target, source = with_priors(scans, real_set, pair, known)
        built = registrar(method, grid, request.opened.selector, math.radians(settings.max_tilt))
        finish_device(built)
        start = perf_counter()
        registration = answer(built, target, source)
        seconds = perf_counter() - start
        cells = {
            "set": real_set.name,
            "pair": pair.name,
            "known": ", ".join(settings.known) if known in draws else known,
            "draw": str(draws.get(known, "")),
            "method": method,
        }
        scored = errors(registration, pair.T_target_source, grid.voxel) | claims(registration)
        return Outcome((cells | {"voxel_m": grid.voxel} | scored,), (cells | {"seconds": seconds},))

    jobs = [
        f"{real_set.key}/{pair.name}/{known}/{method}"
        for real_set in sets.values()
        for pair in (real_set.pairs[:1] if settings.first_only else real_set.pairs)
        for known in (NOTHING, *([FILE] if real_set.priors else []), *draws)
        for method in settings.methods
        if known == NOTHING or "priors" in find_method(method).options
    ]
    deciding = ("edge", "voxel", "max_tilt")
    return Experiment("real", settings, jobs, run, SOURCES, settings.methods, deciding)


def _known(request: Request) -> tuple[str, ...]:
    """The instruments whose measurements are drawn about the truth, of KINDS."""
    idle = [name for name in ("seeds", "seed") if request.known is None and name in request.given]
    if idle:
        raise InputError(f"--{idle[0]} has no effect without --known; give --known too, or leave it out")
    known = () if request.known is None else request.known.split(",")
    if known:
        instruments_for(known)  # refuses unknown ones
    return tuple(kind for kind in KINDS if kind in known)
