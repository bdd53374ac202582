"""Every experiment in a tiny form: rows without times, and a reproducible page with tables."""

from pathlib import Path

import pytest

from sonarmap.kernels.device.device import Device
from sonarmap.tools.lab.reproduce.experiments import EXPERIMENTS, Request, create
from sonarmap.tools.lab.reproduce.folder import write_experiment
from sonarmap.tools.lab.reproduce.run import provenance, run
from sonarmap.tools.lab.reproduce.tables import SHOWN
from tests.samples.experiments.real_folders import put
from tests.tools.lab.reproduce.test_run import silence

FEW = ("hemisphere", "icp")
_CLUTTER = {"scenes": ("clutter",), "first_seed": 3, "edge": 64}
TINY = {
    "translation": {"settings": _CLUTTER | {"steps": (8, 16)}},
    "rotation": {"settings": _CLUTTER | {"yaws_deg": (8, 64)}},
    "limits": {"settings": _CLUTTER | {"tilts_deg": (10,), "yaws_deg": (-40,)}},
    "gaussian": {"grid": 32},
    "floodgate": {"settings": {"methods": ("icp", "hemisphere"), "edges": (32,), "scans": 3}},
    "pairs": {"grid": 32, "method": FEW, "pairs": 1},
    "kinds": {"grid": 32, "method": ("spectral", "icp")},
    "real": {"grid": 32, "method": ("spectral", "icp"), "known": "attitude,depth"},
    "survey": {"settings": {"first_seed": 3, "counts": (5,), "dive": 4, "unusable": 0.2}},
    "scale": {"settings": {"counts": (60,), "points": 2000}},
    "decisions": {"settings": {"scans": 4}},
    "confidence": {"settings": {"counts": {"patch": 1, "unrelated": 1, "still": 2}}},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", EXPERIMENTS)
def test_the_page_of_an_experiment_is_reproducible(name: str, device: Device, tmp_path: Path) -> None:
    folder = put(tmp_path / "in") if EXPERIMENTS[name].folder else None
    experiment = create(name, Request(device, quick=True, folder=folder, **TINY[name]))
    origin = provenance(experiment, device)
    pages = []
    for out in (tmp_path / "a", tmp_path / "b"):
        result = run(experiment, origin, tmp_path, silence)
        shown = experiment.conclude(result.rows) if experiment.conclude else result.rows
        record = write_experiment(out, experiment, result, shown, origin, "the command")
        pages.append({path.name: path.read_bytes() for path in out.iterdir() if path.suffix in (".md", ".csv")})
    assert pages[0] == pages[1]
    assert len(record.tables) == 1 + sum(not table.times for table in SHOWN[name]) or name == "pairs"
    if name == "pairs":
        rows = {which: [row for row in result.rows if row["set"] == which] for which in ("paths", "unrelated")}
        assert [row["step"] for row in rows["paths"]] == [*range(13)] * len(FEW)
        assert all("right" not in row and "nees" not in row for row in rows["unrelated"])
    if name in ("survey", "scale"):  # all usable scans are in one map
        # pyrefly: ignore[unsupported-operation]
        assert all(row["placed"] == row["scans"] - row.get("unusable", 0) for row in result.rows if "placed" in row)
    assert not any(key.endswith("_s") or "second" in key or "memory" in key for row in result.rows for key in row)
