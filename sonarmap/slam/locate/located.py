"""What is known of where a scan was taken in a finished map."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.tangent import sigma_words
from sonarmap.slam.locate.place import Place


@dataclass(frozen=True, slots=True)
class Located:
    """Where a scan was taken in a map.

    Attributes:
        stamp: of the scan [s], or its number where there is no time.
        reason: in words, why the place is believed or not.
        place: the most probable one. Its covariance holds what the scan leaves open against the map, and what the map
            does of its own poses there. None where nothing of the map is like the scan.
        located: whether to believe it.
        psr: peak-to-sidelobe ratio of the registration to the map as it is seen from there; NaN without a place.
        overlap: the share of points with a counterpart in the map seen from there, 0..1, the smaller of both ways.
        alternatives: other places, most probable first.
        tracked: whether it was sought about where the motion expected it, and not in the whole map.
        seconds: time of the scan [s].
    """

    name: str
    stamp: float
    reason: str
    place: Place | None = None
    located: bool = False
    psr: float = math.nan
    overlap: float = 0.0
    alternatives: tuple[Place, ...] = ()
    tracked: bool = False
    seconds: float = 0.0

    @property
    def T_map_scan(self) -> RigidTransform:
        """p_map = T_map_scan p_scan [m]; the identity without a place."""
        return RigidTransform.identity() if self.place is None else self.place.T_map_scan

    @property
    def covariance(self) -> np.ndarray:
        """(6, 6), rotation first [rad, m], of xi in T_map_scan Exp(xi); infinite along the diagonal without a place."""
        return np.diag(np.full(6, np.inf)) if self.place is None else self.place.covariance

    @property
    def probability(self) -> float:
        return 0.0 if self.place is None else self.place.probability

    def __str__(self) -> str:
        verdict = f"{self.name}: {'located' if self.located else 'NOT LOCATED'}, probability {self.probability:.1%}"
        if self.place is None:
            return f"{verdict}\n  {self.reason}"
        x, y, z = self.T_map_scan.translation.tolist()
        sigmas = sigma_words(self.covariance)
        return f"{verdict}\n  at x {x:.3f}, y {y:.3f}, z {z:.3f} m of the map, sigmas {sigmas}\n  {self.reason}"
