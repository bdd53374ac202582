"""A recording damaged at random: refused in words, or every shot that is read as it was, or said to be changed."""

import json
import sys
import tempfile
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds.cloud import Cloud
from sonarmap.tools.files.readers.sonar.recording import stream_sonar
from tests.samples.damage.mutations import mutated
from tests.samples.processor_time import processor_time
from tests.samples.recordings import recording, written

SHOTS = 8


def damage_recordings(folder: Path, count: int, seed: int) -> tuple[Counter[str], list[str], float]:
    """Damage a recording so many times: how it ended, what went wrong, and the longest processor time [s]."""
    path = written(folder / "dive.sonar", recording(SHOTS))
    content, other = (
        path.read_bytes(),
        written(folder / "other.sonar", recording(SHOTS, seed=2, after=100)).read_bytes(),
    )
    clean = {cloud.stamp: cloud for cloud in stream_sonar(path, [])}
    strangers = {cloud.stamp: cloud for cloud in stream_sonar(folder / "other.sonar", [])}
    ends, faults, longest = Counter[str](), list[str](), 0.0
    for number in range(count):
        path.write_bytes(mutated(content, other, np.random.default_rng([seed, number])))
        start, notes = processor_time(), list[str]()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                clouds = list(stream_sonar(path, notes))
        except InputError as error:
            ends["refused" if len(str(error)) > 20 else "refused without a word"] += 1
        except Exception as error:  # noqa: BLE001 - every one of them is a fault to tell
            faults.append(f"{number}: {type(error).__name__}: {str(error)[:200]}")
        else:
            ends["whole" if len(clouds) == SHOTS else "fewer shots"] += 1
            faults += [f"{number}: another shot" for cloud in clouds if not _is_one_of(cloud, clean, strangers)]
            if len(clouds) < SHOTS and not notes and not _is_shorter(clouds):
                faults.append(f"{number}: {len(clouds)} shots, and no word of it")
        longest = max(longest, processor_time() - start)
    return ends, faults, longest


def _is_one_of(cloud: Cloud, *recordings: dict[float | None, Cloud]) -> bool:
    """Whether the shot is the same, to the last bit, as in one of the recordings."""
    wholes = [shots[cloud.stamp] for shots in recordings if cloud.stamp in shots]
    strengths = [None, *(whole.strength for whole in wholes)]
    return any(np.array_equal(cloud.points, whole.points) for whole in wholes) and any(
        cloud.strength is None if other is None else np.array_equal(cloud.strength, other) for other in strengths
    )


def _is_shorter(clouds: list[Cloud]) -> bool:
    """Whether shots are missing at the ends alone, which nothing tells."""
    stamps = [cloud.stamp or 0.0 for cloud in clouds]
    return bool(np.all(np.diff(stamps) < 0.3))


def main() -> None:
    """Print the outcome as JSON; the argument says how many."""
    with tempfile.TemporaryDirectory() as folder:
        print(json.dumps(damage_recordings(Path(folder), int(sys.argv[1]), seed=1)))


if __name__ == "__main__":
    main()
