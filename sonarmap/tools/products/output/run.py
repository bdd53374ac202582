"""What a survey was run with, which travels with its result to the files of its folder."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sonarmap.kernels.device.device import Device
from sonarmap.slam.execute.runner import Timings
from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.files.memory import peak_memory
from sonarmap.tools.files.readers.scans import Unread


@dataclass(frozen=True, slots=True)
class SurveyRun:
    """names: of the scans, in their order.
    settings: as the user gave them or as they were chosen; dataclasses are fine as values.
    device: what it ran on; None for a method that takes none.
    unread: scans that could not be read.
    inputs: the files, as `input_rows` describes them.
    georeference: where the map lies on the Earth; None where it is not known.
    times: how long it took, for times.json: see `survey_times`; None for no such file."""

    names: Sequence[str]
    settings: Mapping[str, Any] = field(default_factory=dict[str, Any])
    device: Device | None = None
    unread: Sequence[Unread] = ()
    inputs: Sequence[Mapping[str, Any]] = ()
    georeference: Georeference | None = None
    times: Mapping[str, Any] | None = None


def survey_times(timings: Timings, workers: int | str) -> dict[str, Any]:
    """The content of `times.json`: what differs between runs that give the same results; `workers` is how many
    processes registered, or the address of the cluster that did."""
    return {
        "workers": workers,
        "pairs_from_journal": timings.from_journal,
        "pairs": timings.pairs,
        "stages_s": timings.stages,
        "peak_memory_bytes": peak_memory(),
    }
