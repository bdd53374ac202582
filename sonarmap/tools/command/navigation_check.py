"""Whether scans contradict the navigation, from some pairs that are registered without it."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from sonarmap.kernels.errors import SonarmapError

if TYPE_CHECKING:
    from sonarmap.slam.pair import RegisteredPair
    from sonarmap.slam.survey_result import SurveyResult
    from sonarmap.spectral.scan import Scan
    from sonarmap.tools.files.geo.georeference import Georeference
    from sonarmap.tools.files.readers.navigation.mistakes import Contradiction


class ContradictedError(SonarmapError):
    """Navigation that would spoil a map."""


def refusing(
    scans: "Sequence[Scan]", file: object, georeference: "Georeference | None" = None
) -> "Callable[[Sequence[RegisteredPair]], None]":
    """What a mapper calls with the pairs that it registered without the scans' priors; it raises ContradictedError
    where these contradict the priors, of a file, and show why. The georeference is that of the priors' places."""

    def vet(free: "Sequence[RegisteredPair]") -> None:
        if (found := contradiction_of(scans, free, georeference)) is not None:
            raise ContradictedError(f"{found}. In {file}: {found.remedy} (docs/navigation.md)")

    return vet


def contradiction_of(
    scans: "Sequence[Scan]", free: "Sequence[RegisteredPair]", georeference: "Georeference | None" = None
) -> "Contradiction | None":
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
    return contradiction([scan.prior for scan in scans], registered, _origin(georeference))


def with_mistake(
    result: "SurveyResult", scans: "Sequence[Scan]", file: object, georeference: "Georeference | None"
) -> "SurveyResult":
    """A map with what would have the scans' priors, of a file, agree with it, where these err more than stated."""
    if not result.understated:
        return result
    from sonarmap.tools.files.readers.navigation.contradictions import contradiction_of_map

    priors, kinds = [scan.prior for scan in scans], tuple(result.understated)
    found = contradiction_of_map(result.solution.graph, priors, kinds, _origin(georeference))
    return result if found is None else replace(result, mistake=f"{found}. In {file}: {found.remedy}")


def _origin(georeference: "Georeference | None") -> tuple[float, float] | None:
    return None if georeference is None else (georeference.latitude, georeference.longitude)
