"""`times.json`: what differs between runs that give the same results."""

from typing import Any

from sonarmap.slam.execute.timings import Timings
from sonarmap.tools.files.memory import peak_memory


def survey_times(timings: Timings, workers: int | str) -> dict[str, Any]:
    """How long a survey took.

    Args:
        timings: of its pairs and stages.
        workers: how many processes registered, or the address of the cluster that did.
    """
    return {
        "workers": workers,
        "pairs_from_journal": timings.from_journal,
        "pairs": timings.pairs,
        "stages_s": timings.stages,
        "peak_memory_bytes": peak_memory(),
    }
