"""Every pair of folders of real scans with known truth, by every method, with the priors that there are and without."""

import zlib
from collections.abc import Sequence
from dataclasses import replace
from math import radians
from pathlib import Path
from time import perf_counter
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.spectral.grid import Grid, choose_grid
from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.readers.navigation.priors import navigate
from sonarmap.tools.files.readers.scans import read_scan
from sonarmap.tools.lab.reproduce.answer import answer, cells_of, finish_device
from sonarmap.tools.lab.reproduce.experiment import ByMethod, Outcome
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.methods import registrar
from sonarmap.tools.lab.reproduce.real.real_set import RealPair, RealSet, read_sets, without_truth
from sonarmap.tools.lab.reproduce.real.section import draw_real, real_section
from sonarmap.tools.lab.reproduce.real.settings import RealSettings, real_settings
from sonarmap.tools.lab.simulate.sensing.navigation import measure_pose
from sonarmap.tools.methods.registry import find_method

NOTHING, FILE = "nothing", "priors.csv"
_TARGET_STREAM, _SOURCE_STREAM = 81, 82


class Real(ByMethod):
    """Registers pairs of real scans; a job is one pair, what is known beforehand, and one method."""

    name = "real"
    make_section, draw_pictures = staticmethod(real_section), staticmethod(draw_real)
    sources: ClassVar[tuple[str, ...]] = (
        *(f"tools/{folder}" for folder in ("files/readers", "lab/evaluate")),
        *(f"tools/lab/reproduce/{name}.py" for name in ("answer", "methods", "real/real_set", "real/settings")),
        *("tools/lab/simulate/sensing/navigation.py", "spectral/grid.py"),
    )
    # the digest of a set and the drawn priors are part of a job's key: another set makes no job run again
    deciding: ClassVar[tuple[str, ...]] = ("edge", "voxel", "max_tilt")

    def __init__(self, sets: Sequence[RealSet], settings: RealSettings, device: str | None) -> None:
        """`device` as `choose_device` takes it."""
        super().__init__(settings, device)
        self._sets = {real_set.key: real_set for real_set in sets}

    def jobs(self) -> Sequence[str]:
        """Set, pair, what is known and method, as in kitchen@1f0c.../0-2/nothing/spectral."""
        return [
            f"{real_set.key}/{pair.name}/{known}/{method}"
            for real_set in self._sets.values()
            for pair in (real_set.pairs[:1] if self.settings.first_only else real_set.pairs)
            for known in (NOTHING, *([FILE] if real_set.priors else []), *self.settings.draws)
            for method in self.methods
            if known == NOTHING or "priors" in find_method(method).options
        ]

    def run(self, job: str) -> Outcome:
        """Register one pair by one method."""
        key, pair_name, known, method = job.split("/")
        real_set = self._sets[key]
        pair = next(pair for pair in real_set.pairs if pair.name == pair_name)
        *scans, grid = self.scans(pair.target, pair.source)
        target, source = self._with_priors(scans, real_set, pair, known)
        built = registrar(method, grid, self.device, radians(self.settings.max_tilt))
        finish_device(built)
        start = perf_counter()
        registration = answer(built, target, source)
        seconds = perf_counter() - start
        cells = {
            "set": real_set.name,
            "pair": pair.name,
            "known": ", ".join(self.settings.known) if known in self.settings.draws else known,
            "draw": str(self.settings.draws.get(known, "")),
            "method": method,
        }
        row = cells | {"voxel_m": grid.voxel} | cells_of(registration, pair.T_target_source, grid.voxel)
        return Outcome((row,), (cells | {"seconds": seconds},))

    def make_scans(self, target: Path, source: Path) -> tuple[Scan, Scan, Grid]:
        """The scans of a pair, and the grid for them."""
        scans = read_scan(target), read_scan(source)
        return *scans, choose_grid(scans, self.settings.edge, self.settings.voxel)

    def _with_priors(self, scans: Sequence[Scan], real_set: RealSet, pair: RealPair, known: str) -> Sequence[Scan]:
        """The scans with what is known of them: a row of the file, or measurements drawn about the truth."""
        if known == NOTHING:
            return scans
        if known == FILE and real_set.priors is not None:
            return navigate(scans, real_set.priors, allow_unknown=True).scans
        poses = RigidTransform.identity(), pair.T_target_source  # the world is the target's frame
        entropy = [self.settings.draws[known], zlib.crc32(f"{real_set.name}/{pair.name}".encode())]
        return [
            replace(
                scan, prior=measure_pose(pose, self.settings.instruments, np.random.default_rng([*entropy, stream]))
            )
            for scan, pose, stream in zip(scans, poses, (_TARGET_STREAM, _SOURCE_STREAM), strict=True)
        ]


def create(request: Request) -> Real:
    """The experiment as the command line asks for it."""
    sets, left_out = read_sets(request.chosen_folder), without_truth(request.chosen_folder)
    settings = real_settings(request, {real_set.name: real_set.digest for real_set in sets}, left_out)
    return Real(sets, settings, request.opened.selector)
