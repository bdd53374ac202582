"""The result of a registration, and the protocol of a registration method."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.spectral.fitted import FITTED
from sonarmap.spectral.scan import Scan


@dataclass(frozen=True, slots=True)
class Registration:
    """One scan registered to another: the transform, its covariance and probability, and the verdict.

    Attributes:
        T_target_source: p_target = T_target_source p_source, both in their sensor frames [m].
        covariance: (6, 6), rotation first [rad, m], of xi in T = T_target_source Exp(xi): the body tangent of
            the source side, the order and side of gtsam.Pose3.
        psr: peak-to-sidelobe ratio of the translation: standard deviations of the peak above the mean;
            NaN from methods without a correlation.
        overlap: share of points with a counterpart in the other scan, 0..1 (the smaller of both directions).
        accepted: whether the registration passed the method's test.
        seconds: time for the pair, without the preparation of its scans [s].
        reason: why it was accepted or refused, in words.
        probability: that the place is right, 0..1, even if the pose is unconstrained in a direction, which the
            covariance shows; NaN from methods that give none.
        step_psr: peak-to-sidelobe ratio of every step, by the step's name.
        alternatives: other hypotheses that could not be excluded, best first.
        T_by_scans, covariance_by_scans: pose and covariance from the scans alone, if instruments or a motion model
            took part in T_target_source; else None. A graph that holds the instruments' measurements as well must use
            these (`by_scans`), or it counts the instruments twice.
        evidence: the numbers behind the transform, by name; docs/registration.md explains them.
    """

    T_target_source: RigidTransform
    covariance: np.ndarray
    psr: float
    overlap: float
    accepted: bool
    seconds: float
    reason: str = ""
    probability: float = float("nan")
    step_psr: tuple[tuple[str, float], ...] = ()
    alternatives: tuple[Registration, ...] = ()
    T_by_scans: RigidTransform | None = None
    covariance_by_scans: np.ndarray | None = None
    evidence: tuple[tuple[str, float], ...] = ()

    def __str__(self) -> str:
        x, y, z = self.T_target_source.translation.tolist()
        turn, sigmas = np.rad2deg(self.T_target_source.rotation.magnitude()), np.sqrt(np.diag(self.covariance))
        sure = "" if np.isnan(self.probability) else f", probability {self.probability:.1%}"
        return (
            f"{'accepted' if self.accepted else 'REFUSED'}{sure}: {self.reason or 'no reason given'}\n"
            f"  source at x {x:.3f}, y {y:.3f}, z {z:.3f} m of the target, turned by {turn:.2f}°\n"
            f"  sigmas up to {sigmas[3:].max():.3f} m and {np.rad2deg(sigmas[:3].max()):.2f}°, overlap "
            f"{self.overlap:.0%}"
        )

    @property
    def fixed(self) -> float:
        """Probability that the scans fix the pose, given the right place; 1 from methods that do not compute it."""
        return dict(self.evidence).get("fixed", 1.0)

    @property
    def is_fixed(self) -> bool:
        """Whether the pose is certain enough to be accepted, given the right place."""
        return self.fixed >= FITTED["acceptance"]["fixed"]

    @property
    def placed(self) -> bool:
        """Whether the place is probable enough, though the pose may be unconstrained in a direction."""
        return self.probability >= FITTED["acceptance"]["place"]

    def with_probability(self, probability: float) -> Registration:
        """The registration with another probability; those of its alternatives are scaled to the remainder."""
        scale = (1 - probability) / (1 - self.probability) if self.probability < 1 else 0.0
        others = tuple(replace(other, probability=scale * other.probability) for other in self.alternatives)
        return replace(self, probability=probability, alternatives=others)

    @property
    def by_scans(self) -> Registration:
        """The registration with pose and covariance from the scans alone; search and verdict still used instruments."""
        if self.T_by_scans is None or self.covariance_by_scans is None:
            return self
        return replace(
            self,
            T_target_source=self.T_by_scans,
            covariance=self.covariance_by_scans,
            alternatives=tuple(alternative.by_scans for alternative in self.alternatives),
            T_by_scans=None,
            covariance_by_scans=None,
        )


class Registrar(Protocol):
    """A registration method, spectral or other; the mapper uses only these two methods."""

    def prepare(self, scan: Scan) -> Any:
        """What a scan contributes to all its pairs, computed once; opaque to all but `register`.

        Raises:
            InputError: the scan shows too little structure to be registered.
        """
        ...

    def register(self, target: Any, source: Any) -> Registration:
        """T_target_source of two prepared scans, with covariance and verdict.

        For scans that do not match, return a registration that is not accepted: a survey reports an InputError as an
        error of the method.
        """
        ...
