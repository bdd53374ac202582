"""Every method on pairs of every kind of scan, with and without priors of instruments."""

from collections.abc import Mapping
from functools import lru_cache
from math import inf, radians

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.kernels.errors import InputError
from sonarmap.spectral.geometry import cross_matrices
from sonarmap.spectral.grid import Grid, choose_grid
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.lab.reproduce.experiments import Experiment, Outcome, Request, Row, Value, as_asked
from sonarmap.tools.lab.reproduce.registrations import SOURCES, answer, claims, compared_methods, errors, registrar
from sonarmap.tools.lab.simulate.kinds.catalog import SCAN_KINDS, kind_pair
from sonarmap.tools.lab.simulate.kinds.kind import KindPair
from sonarmap.tools.lab.simulate.sensing.navigation import Instruments
from sonarmap.tools.methods.registry import find_method

BATCH = 5  # pairs per job
# Neither development nor the tests use pairs of this seed
_USUAL = {"kinds": tuple(SCAN_KINDS), "pairs": 100, "seed": 77014, "edge": 128}
NOTHING, LEVELED, NAVIGATION = "none", "attitude,depth", "navigation"
NAVIGATED = "swath"  # the kind that is also registered with navigation
NAVIGATION_OVERLAPS = (0.05, 0.4)  # range of the overlap of these pairs
# Name of the priors -> the instruments that measure them
PRIORS: Mapping[str, Instruments | None] = {
    NOTHING: None,
    LEVELED: Instruments(attitude=radians(1.5), heading=inf, depth=0.15, position=inf),
    NAVIGATION: Instruments(attitude=radians(1.5), heading=radians(1.5), depth=0.15, position=1.0),
}
DIRECTIONS = (1, 2, 3)


def create(request: Request) -> Experiment:
    """A job is five pairs of a kind by one method with some priors, as swath/none/003/spectral; `quick` runs one batch
    of two kinds on grids of half the edge."""
    usual = _USUAL | compared_methods(request)
    settings = as_asked(request, usual, {"kinds": ("patch", "swath"), "pairs": BATCH, "edge": 64})

    @lru_cache(maxsize=1)
    def pairs_of(kind: str, navigated: bool, batch: int) -> list[tuple[KindPair, Grid]]:
        """Pairs of a batch without priors, each with its grid; a pair that cannot be simulated is left out."""
        pairs = []
        for number in range(batch * BATCH, (batch + 1) * BATCH):
            try:
                pair = kind_pair(kind, number, settings.seed, NAVIGATION_OVERLAPS if navigated else None)
            except InputError:
                continue
            pairs.append((pair, choose_grid((pair.target, pair.source), settings.edge)))
        return pairs

    def run(job: str) -> Outcome:
        kind, known, batch, method = job.split("/")
        pairs = pairs_of(kind, known == NAVIGATION, int(batch))
        device = request.opened.selector
        return Outcome(tuple(_row(pair, grid, known, method, device) for pair, grid in pairs))

    jobs = [
        f"{kind}/{known}/{batch:03d}/{method}"
        for kind in settings.kinds
        for batch in range(-(-settings.pairs // BATCH))
        for known in PRIORS
        for method in settings.methods
        if known == NOTHING or ("priors" in find_method(method).options and (known != NAVIGATION or kind == NAVIGATED))
    ]
    return Experiment("kinds", settings, jobs, run, (*SOURCES, "tools/lab/reproduce/kinds.py"), settings.methods)


def _row(pair: KindPair, grid: Grid, known: str, method: str, device: str | None) -> Row:
    instruments = PRIORS[known]
    measured = pair if instruments is None else pair.with_priors(instruments)
    registration, _ = answer(registrar(method, grid, device), measured.target, measured.source)
    cells: dict[str, Value] = {name: getattr(pair, name) for name in ("kind", "number", "scene", "relief", "shared")}
    cells |= {"priors": known, "method": method, "voxel_m": grid.voxel}
    cells |= errors(registration, pair.T_target_source, grid.voxel) | claims(registration)
    if known == NAVIGATION and measured.target.prior is not None and measured.source.prior is not None:
        cells |= navigation_cells(registration, pair.T_target_source, measured.target.prior, measured.source.prior)
    return cells


def navigation_cells(
    registration: Registration, truth: RigidTransform, target: PosePrior, source: PosePrior
) -> dict[str, Value]:
    """Standard deviations and signed errors of a registration and of navigation alone, along three directions [m].

    The directions are the eigenvectors of the translation's covariance in the target's axes, ordered by growing
    standard deviation. The priors measure both poses completely. Empty if the registration has no covariance.
    """
    covariance = np.asarray(registration.covariance)[3:, 3:]
    if not np.isfinite(covariance).all():
        return {}
    R = registration.T_target_source.rotation.as_matrix()  # the covariance is in the source's axes
    variances, axes = np.linalg.eigh(R @ covariance @ R.T)
    navigated = target.T_world_sensor.inv() * source.T_world_sensor
    navigation_sigmas = np.sqrt(np.einsum("ik,ij,jk->k", axes, navigation_covariance(target, source), axes))
    columns = {
        "sigma_m": np.sqrt(np.maximum(variances, 0.0)),
        "navigation_sigma_m": navigation_sigmas,
        "error_m": (registration.T_target_source.translation - truth.translation) @ axes,
        "navigation_error_m": (navigated.translation - truth.translation) @ axes,
    }
    return {
        f"direction{number}_{name}": float(values[number - 1])
        for number in DIRECTIONS
        for name, values in columns.items()
    }


def navigation_covariance(target: PosePrior, source: PosePrior) -> np.ndarray:
    """(3, 3) covariance of the translation of T_target_source by the priors, in the target's axes [m^2]: from the
    errors of both positions and of the target's rotation."""
    baseline = source.T_world_sensor.translation - target.T_world_sensor.translation
    lever = cross_matrices(baseline[None])[0]
    world = np.diag(target.sigmas[3:] ** 2 + source.sigmas[3:] ** 2)
    world += lever @ np.diag(target.sigmas[:3] ** 2) @ lever.T
    R = target.T_world_sensor.rotation.as_matrix()
    return R.T @ world @ R
