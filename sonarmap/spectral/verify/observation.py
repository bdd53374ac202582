"""What the scans show of poses: by their views, and by the surfaces that they share."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonarmap.spectral.prepare.range_image import Visibility
from sonarmap.spectral.verify.fit import Fit, firmness
from sonarmap.spectral.verify.hypothesis import Evidence
from sonarmap.spectral.verify.shared_surface import SharedSurface

# A contradiction weighs as so many agreements; a share of points that is small beside the least hardly counts.
_WEIGHT, _LEAST = 4.0, 0.05


def consistency(agree: np.ndarray | float, contradict: np.ndarray | float) -> np.ndarray | float:
    """The share of agreeing points among those that agree or contradict, 0..1; a contradiction counts several times.

    Not a share of all points: where scans have little in common few can agree, and few can contradict.
    """
    return agree / (agree + _WEIGHT * contradict + _LEAST)


@dataclass(frozen=True, slots=True)
class Observation:
    """What the scans show of k poses.

    Attributes:
        views, coarse_views: (k,) consistency of the views, with a tight and with a wide tolerance.
        surfaces: what the scans share under each.
    """

    views: list[float]
    coarse_views: list[float]
    surfaces: list[SharedSurface]

    @classmethod
    def of(cls, views: Sequence[Visibility], surfaces: list[SharedSurface]) -> "Observation":
        """From the views, by a tight and by a wide tolerance, and the surfaces."""
        fine, coarse = (np.asarray(consistency(view.agree, view.contradict)).tolist() for view in views)
        return cls(fine, coarse, surfaces)

    def evidence(self, fits: Sequence[Fit]) -> list[Evidence]:
        """Of these poses, which are refined."""
        firmnesses = firmness(
            np.stack([fit.information for fit in fits]), np.array([fit.pairs for fit in fits])
        ).tolist()
        return [
            Evidence(
                view=view,
                coarse_view=coarse_view,
                surface=surface.consistency,
                overlap=surface.overlap,
                residual=fit.residual,
                width=fit.width,
                firmness=firm,
                measured=0.0 if fit.prior is None else float(fit.prior.squared()),
            )
            for fit, view, coarse_view, surface, firm in zip(
                fits, self.views, self.coarse_views, self.surfaces, firmnesses, strict=True
            )
        ]
