"""What an experiment makes of its rows."""

from collections.abc import Sequence
from pathlib import Path

from sonarmap.tools.lab.reproduce.experiment import Experiment, Row, Section
from sonarmap.tools.lab.reproduce.folder import verdicts


def run_all(experiment: Experiment) -> tuple[list[Row], list[Row]]:
    """The rows and the times of all jobs."""
    done = [experiment.run(job) for job in experiment.jobs()]
    return [row for outcome in done for row in outcome.rows], [row for outcome in done for row in outcome.seconds]


def show(experiment: Experiment, folder: Path, rows: Sequence[Row], seconds: Sequence[Row] = ()) -> Section:
    """The section, with a table of claims, whose pictures are those that are drawn; no row holds a time."""
    section = experiment.section(rows, seconds)
    verdicts(section)
    folder.mkdir(exist_ok=True)
    experiment.draw(folder, rows)
    assert {path.name for path in folder.iterdir()} == set(section.pictures)
    assert not any(key.endswith("_s") or "second" in key or "memory" in key for row in rows for key in row)
    return section
