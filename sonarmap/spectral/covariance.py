"""The covariance of a refined pose, from its planes, its correlation peak, and instruments."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform
from scipy.special import expit

from sonarmap.spectral.chi_squared import chi_squared
from sonarmap.spectral.fitted import FITTED
from sonarmap.spectral.geometry import covariance_at_sensor, rotated
from sonarmap.spectral.grid import Grid, coarse_edge
from sonarmap.spectral.verify.fit import CALIBRATION, Fit, PriorTerm, principal_axes
from sonarmap.spectral.verify.hypothesis import Hypothesis
from sonarmap.spectral.verify.verifier import Observability

ELLIPSOID = float(chi_squared(0.95, 6))
_TELLING = 0.01  # with less information than this share of the instruments', scans are taken to agree with them
_DOUBTS = 2.0  # standard errors up to which the information of planes is not significant
_UNHELD = 10.0  # sigma of an unconstrained direction [half turns; grid edges]
_LEAST = 1e-9  # minimum information in any direction [points]
_WHITENING = 1  # index of the one of `WHITENINGS` that shows best how far scans can slide
_MOST_EXPONENT = 50.0  # of an exponential function
_RARE = 0.03  # less probable slides are outliers, left to the graph's outlier rejection


def slides_of(seen: Observability) -> np.ndarray:
    """(3, bands) logarithm of the correlation some voxels off the peak along each direction, as a share of the peak."""
    return np.log(seen.slides[:, :, _WHITENING])


@dataclass(frozen=True, slots=True)
class Slide:
    """Model of how far scans may have slid along a direction, by the correlation beside the peak: the planes do not
    show that the scans may also fit at the next post or ripple."""

    # odds, weight: log odds of a slide, linear in the logarithm of the correlation's share
    odds: float
    weight: float
    reach: float  # root mean square length of a slide [voxels of the coarse grid]

    def variance(self, seen: Observability, grid: Grid, prior: PriorTerm | None = None) -> np.ndarray:
        """(3,) [voxels^2], along the axes of `seen`; of slides within the prior, about the pose by the scans alone.

        After a slide the pose is farther from what instruments measured, so that by Bayes' rule they exclude slides
        beyond their sigmas.
        """
        slid = np.maximum(expit(self.odds + self.weight * slides_of(seen)[:, 0]) - _RARE, 0.0)
        reach = (self.reach * grid.edge / coarse_edge(grid.edge)) ** 2
        if prior is None:
            return slid * reach
        measured = np.linalg.inv(prior.normal_equations()[0] + _unknown(grid))[3:, 3:]
        variance = np.einsum("ia,ij,ja->a", seen.axes, measured, seen.axes)
        off = seen.axes.T @ (np.linalg.pinv(prior.jacobian) @ prior.residual)[3:]
        nearer = off**2 / 2 * (1 / variance - 1 / (variance + reach))
        ratio = np.sqrt(variance / (variance + reach)) * np.exp(np.minimum(nearer, _MOST_EXPONENT))
        return slid * ratio / (slid * ratio + 1 - slid) * variance * reach / (variance + reach)


SLIDE = Slide(**FITTED["slide"])


@dataclass(frozen=True, slots=True)
class PoseCovariance:
    """Covariances of T_target_source, rotation first, body tangent of the source's sensor frame [rad, m]."""

    posterior: np.ndarray  # (6, 6), by the scans and the instruments
    by_scans: np.ndarray  # (6, 6), by the scans alone, with the distortion that the instruments reveal
    by_instruments: np.ndarray | None  # (6, 6), by the instruments alone; None without any
    # (6,) from the refined pose to that by the scans alone, as `Fit.step`, but near 0 along directions that only the
    # instruments constrain
    step: np.ndarray


def fit_covariance(
    hypothesis: Hypothesis,
    centers: tuple[np.ndarray, np.ndarray],
    grid: Grid,
    seen: Observability | None = None,
    slide: Slide = SLIDE,
    is_measured: bool = True,
) -> PoseCovariance:
    """The covariance of a refined pose, whose evidence is measured on the whole grid.

    Rotation and translation are estimated jointly. The variance is large along a bare wall, and in three directions for
    a single plane: sigmas reach ten times half a turn and the grid's edge. `centers` are the target's and the source's
    grid centers, (3,) each [m, each in its sensor frame]. `seen` is the observability at the pose, None if it was not
    measured. A prior excludes slides only if it `is_measured` by instruments: the usual motion is learned from poses
    that may have slid.
    """
    fit = hypothesis.fit
    target_center, source_center = (center / grid.voxel for center in centers)
    away = target_center + fit.shift, fit.R.apply(source_center)
    _, _, lever = principal_axes(fit.information, fit.pairs)
    by_scans = _by_planes(hypothesis) + CALIBRATION.systematic(*away, lever, fit.stretch is not None)
    by_scans *= CALIBRATION.other_kinds
    if seen is not None:
        prior = fit.prior.moved(fit.step) if fit.prior is not None and is_measured else None
        by_scans[3:, 3:] += (seen.axes * slide.variance(seen, grid, prior)) @ seen.axes.T
    unknown = _unknown(grid)
    by_scans = np.linalg.inv(np.linalg.inv(by_scans) + unknown)
    posterior, by_instruments, step = by_scans, None, fit.step
    if fit.prior is not None:
        by_scans = by_scans + fit.prior.distortion(by_scans, fit.step)
        information, measured = np.linalg.inv(by_scans), fit.prior.normal_equations()[0]
        posterior = np.linalg.inv(information + measured)
        step = np.linalg.solve(information + _TELLING * measured, information @ fit.step)
        by_instruments = np.linalg.inv(measured + unknown)
    back = fit.R.inv()  # from the target's axes to the source's
    meters = np.outer(*[np.repeat([1.0, grid.voxel], 3)] * 2)
    at_sensor = (
        None if each is None else covariance_at_sensor(rotated(back, each) * meters, centers[1])
        for each in (posterior, by_scans, by_instruments)
    )
    # pyrefly: ignore[bad-argument-type]
    return PoseCovariance(*at_sensor, step=step)


def _unknown(grid: Grid) -> np.ndarray:
    """(6, 6) information of a direction that nothing constrains [1/rad^2, 1/voxels^2]."""
    return np.diag((_UNHELD * np.repeat([np.pi, float(grid.edge)], 3)) ** -2.0)


def covers(covariance: np.ndarray, T: RigidTransform, other: RigidTransform) -> bool:
    """Whether another pose lies in the 95 % ellipsoid of T, whose covariance (6, 6) is as in `PoseCovariance`."""
    away: np.ndarray = (T.inv() * other).as_exp_coords()
    return float(away @ np.linalg.solve(covariance, away)) <= ELLIPSOID


def _by_planes(hypothesis: Hypothesis) -> np.ndarray:
    """Covariance (6, 6) by the planes, of a turn about the target's axes at the source's grid center and a shift."""
    fit = hypothesis.fit
    share, axes, lever = principal_axes(fit.information, fit.pairs)
    variance = float(CALIBRATION.variance(np.array(fit.width), hypothesis.evidence.psr))
    # information no larger than its standard error is ignored
    share = np.maximum(share, _LEAST)
    sure = 1 - (_DOUBTS * fit.doubt / share) ** 2
    axes = axes / np.repeat([max(float(lever), 1e-6), 1.0], 3)[:, None]
    held = (axes * (sure > 0) / np.maximum(share * fit.pairs, _LEAST)) @ axes.T
    by_planes = (axes * variance / np.maximum(sure * share * fit.pairs, _LEAST)) @ axes.T
    return by_planes + by_stretch(fit, held)


def by_stretch(fit: Fit, held: np.ndarray) -> np.ndarray:
    """Covariance (6, 6) from the unknown stretch of the ranges, in the directions of `held`, the (6, 6) inverse of the
    information."""
    if fit.stretching is None:
        return np.zeros((6, 6))
    across, both = fit.stretching[:, :6], fit.stretching[:, 6:]
    response = -held @ across.T
    values, axes = np.linalg.eigh(both + across @ response)
    by_planes = np.maximum(values, 0.0) / float(CALIBRATION.variance(np.array(fit.width)))
    shares = (axes / (by_planes + CALIBRATION.stretched**-2)) @ axes.T
    return response @ shares @ response.T
