"""The result of a registration, and what a method of registration is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.spectral.fitted import FITTED
from sonarmap.spectral.scan import Scan


@dataclass(frozen=True, slots=True)
class Registration:
    """One scan registered to another: the transform, how sure it is, and whether to believe it.

    Attributes:
        T_target_source: p_target = T_target_source p_source, both in their sensor frames [m].
        covariance: (6, 6), rotation first [rad, m], of xi in T = T_target_source Exp(xi): the body tangent of
            the source side, the order and side of gtsam.Pose3.
        psr: peak-to-sidelobe ratio of the translation: standard deviations of the peak above the mean;
            NaN from methods without a correlation.
        overlap: the share of points with a counterpart in the other scan, 0..1 (the smaller of both ways).
        accepted: whether to believe it.
        seconds: time of the pair alone, the scans being prepared [s].
        reason: in words, why it was accepted or refused.
        probability: that the place is right, 0..1, however open the pose may be there, which the covariance says; NaN
            from methods that give none.
        step_psr: the peak-to-sidelobe ratio of every step, by the step's name.
        alternatives: other hypotheses that could not be excluded, best first.
        T_by_scans, covariance_by_scans: what the scans alone say, where instruments, or how the vehicle usually moves,
            took part in T_target_source; in the same units, None where they did not. A graph that holds the
            instruments' measurements as well would otherwise count them twice: `by_scans` is for it.
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
        """The probability that the pose is fixed, where the place is right; 1 from methods that do not say."""
        return dict(self.evidence).get("fixed", 1.0)

    @property
    def is_fixed(self) -> bool:
        """Whether its pose is sure enough to be accepted where its place is right."""
        return self.fixed >= FITTED["acceptance"]["fixed"]

    @property
    def is_only_likely(self) -> bool:
        """Whether it is believed as scans that follow each other nearly always share a place, and not by itself."""
        return "likely" in dict(self.evidence)

    @property
    def placed(self) -> bool:
        """Whether it has found the place, though it may leave a direction open there."""
        return self.probability >= FITTED["acceptance"]["place"]

    def with_probability(self, probability: float) -> Registration:
        """The same answer with another probability; what that leaves, its alternatives share as before."""
        left = (1 - probability) / (1 - self.probability) if self.probability < 1 else 0.0
        others = tuple(replace(other, probability=left * other.probability) for other in self.alternatives)
        return replace(self, probability=probability, alternatives=others)

    @property
    def by_scans(self) -> Registration:
        """The same registration without what instruments said of the pose; they still found it and judged it."""
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
    """A method of registration: spectral, or any other. The mapper uses nothing else of it."""

    def prepare(self, scan: Scan) -> Any:
        """What one scan contributes to every pair, computed once; only `register` looks into it.

        Raises:
            InputError: the scan cannot be registered, as it shows too little structure.
        """
        ...

    def register(self, target: Any, source: Any) -> Registration:
        """T_target_source of two prepared scans, its covariance, and whether to believe it.

        Scans that do not fit are no error: the result is one that is not accepted. A survey calls an InputError an
        error of the method.
        """
        ...
