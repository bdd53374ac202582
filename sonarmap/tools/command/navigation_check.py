"""Whether scans contradict the navigation, from some pairs that are registered without it.

A map's own registrations cannot say: they are searched for where the navigation has them.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from sonarmap.kernels.errors import SonarmapError
from sonarmap.tools.command.progress import growing_progress

if TYPE_CHECKING:
    from sonarmap.spectral.result import Registrar
    from sonarmap.spectral.scan import Scan
    from sonarmap.tools.files.readers.navigation.contradictions import Contradiction

_EVENLY, _TURNING = 8, 8  # pairs: spread over the survey, and those between which it turns most


def contradiction_of(
    scans: "Sequence[Scan]", surveys: Sequence[int], registrar: "Registrar", quiet: bool
) -> "Contradiction | None":
    """What is wrong with the scans' priors, if the scans, each of its survey, say so; None also where there are few
    priors."""
    import numpy as np
    from scipy.spatial.transform import RigidTransform

    from sonarmap.tools.files.readers.navigation.contradictions import LEAST_PAIRS, Registered, contradiction

    pairs = _chosen(scans, surveys)
    if len(pairs) < LEAST_PAIRS:
        return None
    sure, transforms, covariances = [], [], []
    with growing_progress("checking navigation", quiet) as step:
        for number, (i, j) in enumerate(pairs):
            step(number, len(pairs), f"{scans[i].name} - {scans[j].name}")
            try:
                target, source = (registrar.prepare(replace(scans[k], prior=None)) for k in (i, j))
                registration = registrar.register(target, source)
            except SonarmapError:
                continue  # the map tells why, if it is as bad there
            if registration.accepted:
                sure.append((i, j))
                transforms.append(registration.T_target_source)
                covariances.append(registration.covariance)
        step(len(pairs), len(pairs), "")
    if len(sure) < LEAST_PAIRS:
        return None
    i, j = np.array(sure).T
    registered = Registered(i, j, RigidTransform.concatenate(transforms), np.array(covariances))
    return contradiction([scan.prior for scan in scans], registered)


def _chosen(scans: "Sequence[Scan]", surveys: Sequence[int]) -> list[tuple[int, int]]:
    """Consecutive scans of a survey that both have priors: some evenly spread, and those that are turned most."""
    import numpy as np

    turns: list[float] = []
    pairs: list[tuple[int, int]] = []
    for k in range(len(scans) - 1):
        first, second = scans[k].prior, scans[k + 1].prior
        if first is None or second is None or surveys[k] != surveys[k + 1]:
            continue
        pairs.append((k, k + 1))
        turns.append(float((first.T_world_sensor.rotation.inv() * second.T_world_sensor.rotation).magnitude()))
    most = np.argsort(turns)[::-1][:_TURNING].tolist()
    evenly = np.linspace(0, len(pairs) - 1, _EVENLY).round().astype(int).tolist() if pairs else []
    return [pairs[k] for k in sorted({*most, *evenly})]
