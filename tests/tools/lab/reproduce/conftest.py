"""The fake experiment that the tests share."""

from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest

from sonarmap.tools.lab.reproduce import figures, tables
from sonarmap.tools.lab.reproduce.experiments import EXPERIMENTS, ExperimentEntry
from sonarmap.tools.lab.reproduce.figures import Figure
from sonarmap.tools.lab.reproduce.render import Table, number
from tests.samples.experiments import fake_experiment


def draw(path: Path, frame: pd.DataFrame, _settings: SimpleNamespace) -> None:
    from matplotlib.figure import Figure as Plot

    plot = Plot(figsize=(1, 1))
    plot.subplots().plot(frame["value"])
    plot.savefig(path)


@pytest.fixture
def faked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Add the fake experiment, with a table, a table of times and a figure."""
    entry = ExperimentEntry("Fig. 0", fake_experiment.__name__, ("seed",))
    for module in ("lab.reproduce.experiments", "lab.reproduce.folder", "command.verbs.reproduce"):
        monkeypatch.setattr(f"sonarmap.tools.{module}.EXPERIMENTS", {**EXPERIMENTS, "fake": entry})
    means = Table("Means", ("high",), {"mean": number("value", 6, "mean")})
    times = Table("Times", ("job",), {"s": number("seconds", 2)}, times=True)
    monkeypatch.setattr("sonarmap.tools.lab.reproduce.folder.SHOWN", {**tables.SHOWN, "fake": (means, times)})
    monkeypatch.setattr("sonarmap.tools.lab.reproduce.folder.FIGURES", {**figures.FIGURES, "fake": Figure("N", draw)})
