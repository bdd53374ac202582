"""`times.json`: what differs between runs that give the same results."""

from typing import Any

from slam.execute.timings import Account
from tools.bench.machine import peak_memory


def survey_times(account: Account, workers: int | str) -> dict[str, Any]:
    """How long a survey took.

    Args:
        account: of its pairs and stages.
        workers: how many processes registered, or the address of the cluster that did.
    """
    return {
        "workers": workers,
        "pairs_found": account.found,
        "pairs": account.pairs,
        "stages_s": account.stages,
        "peak_memory_bytes": peak_memory(),
    }
