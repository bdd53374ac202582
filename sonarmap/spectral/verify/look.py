"""What the scans show of poses: their views and the surfaces that they share, queued together and read together."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sonarmap.spectral.prepare.range_image import Views
from sonarmap.spectral.translation import NearShifts
from sonarmap.spectral.verify.fit import Fit, firmness
from sonarmap.spectral.verify.hypothesis import Evidence, Hypothesis, alike
from sonarmap.spectral.verify.shared_surface import SharedSurface, SharedSurfaces

# A contradiction weighs as so many agreements; a share of points that is small beside the least hardly counts.
_WEIGHT, _LEAST = 4.0, 0.05


def consistency(agree: np.ndarray | float, contradict: np.ndarray | float) -> np.ndarray | float:
    """The share of agreeing points among those that agree or contradict, 0..1; a contradiction counts several times.

    Not a share of all points: where scans have little in common few can agree, and few can contradict.
    """
    return agree / (agree + _WEIGHT * contradict + _LEAST)


@dataclass(frozen=True, slots=True)
class Seen:
    """What k poses make of the scans.

    Attributes:
        views, coarse_views: (k,) consistency of the views, with a tight and with a wide tolerance.
        surfaces: what the scans share under each.
    """

    views: list[float]
    coarse_views: list[float]
    surfaces: list[SharedSurface]

    def of(self, fits: Sequence[Fit]) -> list[Evidence]:
        """The evidence of k refined poses."""
        firm = firmness(np.stack([fit.information for fit in fits]), np.array([fit.pairs for fit in fits])).tolist()
        return [
            Evidence(
                view=view,
                coarse_view=coarse_view,
                surface=surface.consistency,
                overlap=surface.overlap,
                residual=fit.residual,
                width=fit.width,
                firmness=held,
                measured=0.0 if fit.prior is None else float(fit.prior.squared()),
            )
            for fit, view, coarse_view, surface, held in zip(
                fits, self.views, self.coarse_views, self.surfaces, firm, strict=True
            )
        ]


class Look:
    """A look at k poses, on its way to the host."""

    def __init__(self, views: Views, surfaces: SharedSurfaces) -> None:
        """What `Verifier.look` has queued, in this order, for a fine and a coarse tolerance."""
        self._views, self._surfaces = views, surfaces

    def read(self) -> Seen:
        """What the scans show; one wait."""
        surfaces = self._surfaces.read()
        fine, coarse = (np.asarray(consistency(seen.agree, seen.contradict)).tolist() for seen in self._views.read())
        return Seen(fine, coarse, surfaces)


class Measurement:
    """The correlations at hypotheses' poses, on their way to the host."""

    def __init__(self, hypotheses: Sequence[Hypothesis], fine: NearShifts, coarse: NearShifts) -> None:
        """What `Verifier.measure` has queued, in this order."""
        self._hypotheses, self._fine, self._coarse = hypotheses, fine, coarse

    def read(self) -> list[Hypothesis]:
        """The hypotheses with the peaks at their poses on both grids; one wait."""
        coarse, fine = self._coarse.highest(), self._fine.highest()
        return [
            replace(hypothesis, evidence=replace(hypothesis.evidence, psr=peak.psr, coarse_psr=coarse_peak.psr))
            for hypothesis, peak, coarse_peak in zip(self._hypotheses, fine, coarse, strict=True)
        ]


def ranked(hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Hypotheses by what the scans saw, best first; of those at the same pose the best alone."""
    distinct: list[Hypothesis] = []
    for hypothesis in sorted(hypotheses, key=lambda hypothesis: -hypothesis.candidate_score):
        if not any(alike(hypothesis.fit, kept.fit) for kept in distinct):
            distinct.append(hypothesis)
    return distinct
