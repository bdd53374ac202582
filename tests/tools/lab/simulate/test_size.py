"""Simulations that no machine can hold: refused at once, with the largest that this one can."""

import json
import re
from pathlib import Path

import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.simulate.simulation import check_size, simulate
from tests.samples.clutter_scans import refused_with_reason, said, sonarmap
from tests.samples.damage.pose_files import POSE_FILES


def description(folder: Path, **values: float) -> Path:
    """A description.json with other values for settings or for the sensor."""
    content = json.loads(POSE_FILES["description.json"].content)
    for name, value in values.items():
        part = content["settings"] if name in content["settings"] else content["settings"]["sensor"]
        part[name] = value
    path = folder / "description.json"
    path.write_text(json.dumps(content))
    return path


@pytest.mark.parametrize(
    "values", [{"count": 10**12}, {"columns": 10**12}, {"rows": 2**62}, {"rows": 10**7, "columns": 10**7}]
)
def test_a_description_of_too_much_is_refused(tmp_path: Path, values: dict[str, int]) -> None:
    result = sonarmap("simulate", "--like", description(tmp_path, **values), "-o", tmp_path / "out")
    refused_with_reason(result)
    asked = "scans of" if "count" in values else "columns and"
    said(result, "error: ", asked, "GiB of memory", "this machine has", "give at most")
    assert not (tmp_path / "out").exists()


def test_the_option_is_named(tmp_path: Path) -> None:
    result = sonarmap("simulate", "--scans", str(10**11), "-o", tmp_path / "out")
    refused_with_reason(result)
    said(result, "100,000,000,000 scans of 49,152 beams need", "scans (--scans), or a sensor of fewer beams")


@pytest.mark.parametrize(("given", "beams"), [((10**6, 256), 192), ((1, 10**5), 10**5)])
def test_the_largest_that_is_named_is_taken(
    monkeypatch: pytest.MonkeyPatch, given: tuple[int, int], beams: int
) -> None:
    monkeypatch.setattr("sonarmap.tools.lab.simulate.simulation.available_memory", lambda: 10**9)
    with pytest.raises(InputError) as caught:
        check_size(*given, beams)
    most = int(re.findall(r"at most ([\d,]+)", str(caught.value))[0].replace(",", ""))

    def check(number: int) -> None:
        check_size(*((1, number, 1) if given[0] == 1 else (number, given[1], beams)))

    check(most)
    with pytest.raises(InputError):
        check(most + 1)


@pytest.mark.parametrize("reason", ["Unable to allocate 9 GiB", ""])
def test_memory_that_runs_out_all_the_same_is_told(
    reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise MemoryError(reason)

    monkeypatch.setattr("sonarmap.tools.lab.simulate.simulation.simulate", full)
    result = sonarmap("simulate", "-o", tmp_path / "out")
    refused_with_reason(result)
    said(result, f"this machine's memory is used up{reason and f' ({reason})'}; give less at a time")


@pytest.mark.parametrize("values", [{"max_range": 1e29}, {"max_range": 1e6}])
def test_ranges_that_no_reader_takes_are_refused(tmp_path: Path, values: dict[str, float]) -> None:
    result = sonarmap("simulate", "--like", description(tmp_path, **values), "-o", tmp_path / "out")
    assert result.exit_code == 2
    said(result, "max_range <= 100000 m")


def test_a_lobe_next_to_nothing_is_refused(tmp_path: Path) -> None:
    result = sonarmap("simulate", "--lobe", "1e-300", "-o", tmp_path / "out")
    assert result.exit_code == 2
    said(result, "lobe is 1e-300; wanted 0, or a width of 0.05 to 8 beams")


def test_what_fits_is_simulated(tmp_path: Path) -> None:
    from sonarmap.tools.lab.simulate.folder import read_settings

    assert len(simulate(read_settings(description(tmp_path))).scans) == 3
