"""The fake experiment that the tests share."""

import pytest

from sonarmap.tools.lab.reproduce import tables
from sonarmap.tools.lab.reproduce.experiments import EXPERIMENTS, ExperimentEntry
from sonarmap.tools.lab.reproduce.render import Table, number
from tests.samples.experiments import fake_experiment


@pytest.fixture
def faked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Add the fake experiment, with a table and a table of times."""
    entry = ExperimentEntry("Fig. 0", fake_experiment.__name__, ("seed",))
    for module in ("lab.reproduce.experiments", "lab.reproduce.folder", "command.verbs.reproduce"):
        monkeypatch.setattr(f"sonarmap.tools.{module}.EXPERIMENTS", {**EXPERIMENTS, "fake": entry})
    means = Table("Means", ("high",), {"mean": number("value", 6, "mean")})
    times = Table("Times", ("job",), {"s": number("seconds", 2)}, times=True)
    monkeypatch.setattr("sonarmap.tools.lab.reproduce.folder.SHOWN", {**tables.SHOWN, "fake": (means, times)})
