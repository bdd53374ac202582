"""Whether scans contradict the navigation, from some pairs that are registered without it."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from sonarmap.kernels.errors import SonarmapError

if TYPE_CHECKING:
    from sonarmap.slam.pair import RegisteredPair
    from sonarmap.spectral.scan import Scan
    from sonarmap.tools.files.readers.navigation.contradictions import Contradiction


class ContradictedError(SonarmapError):
    """Navigation that would spoil a map."""


def refusing(scans: "Sequence[Scan]", file: object) -> "Callable[[Sequence[RegisteredPair]], None]":
    """What a mapper calls with the pairs that it registered without the scans' priors; it raises ContradictedError
    where these contradict the priors, of a file, and show why."""

    def vet(free: "Sequence[RegisteredPair]") -> None:
        if (found := contradiction_of(scans, free)) is not None:
            raise ContradictedError(f"{found}. In {file}: {found.remedy} (docs/navigation.md)")

    return vet


def contradiction_of(scans: "Sequence[Scan]", free: "Sequence[RegisteredPair]") -> "Contradiction | None":
    """What is wrong with the scans' priors, if pairs registered without them say so; None also where these are few."""
    import numpy as np
    from scipy.spatial.transform import RigidTransform

    from sonarmap.tools.files.readers.navigation.contradictions import LEAST_PAIRS, Registered, contradiction

    sure = [(*pair.scans, pair.registration) for pair in free if pair.registration is not None]
    if len(sure) < LEAST_PAIRS:
        return None
    i, j, registrations = zip(*sure, strict=True)
    transforms = RigidTransform.concatenate([each.T_target_source for each in registrations])
    registered = Registered(np.array(i), np.array(j), transforms, np.array([each.covariance for each in registrations]))
    return contradiction([scan.prior for scan in scans], registered)
