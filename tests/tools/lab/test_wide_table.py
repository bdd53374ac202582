"""Wide tables on narrow terminals."""

import io

import pytest
from rich.console import Console
from rich.text import Text

from sonarmap.tools.lab.wide_table import WideTable

TABLE = WideTable(
    ("kernel", "time of the device", "twin", "quartiles", "share of the limit"),
    (
        ("transform", "12345.678", "scipy.fft", "[12.5..1300.25]", "97%"),
        ("  of which: rows", Text("WRONG 1.2e-03"), "", "", ""),
        ("peaks, and where they are", "0.25", "numpy, argsort and a comparison of 27 voxels", "[0.1..0.3]", "3%"),
    ),
    right=frozenset({1, 3, 4}),
    title="kernels at 64^3",
)


def printed(table: WideTable, columns: int) -> list[str]:
    out = io.StringIO()
    Console(file=out, width=columns).print(table)
    return out.getvalue().splitlines()


@pytest.mark.parametrize("columns", [30, 40, 60, 80, 100, 200])
def test_every_number_is_whole_at_any_width(columns: int) -> None:
    lines = printed(TABLE, columns)
    assert max(map(len, lines)) <= columns
    assert not any("…" in line for line in lines)
    words = " ".join(lines).split()
    for number in ("12345.678", "[12.5..1300.25]", "[0.1..0.3]", "97%", "1.2e-03", "scipy.fft"):
        assert number in words


def test_where_there_is_room_it_is_one_table() -> None:
    lines = printed(TABLE, 200)
    assert len(lines) == 1 + 1 + 3
    assert " ".join(lines[1].split()) == "kernel time of the device twin quartiles share of the limit"


def test_further_columns_stand_below_with_the_names_of_their_rows() -> None:
    lines = printed(TABLE, 60)
    parts = [part.splitlines() for part in "\n".join(line.rstrip() for line in lines).split("\n\n")]
    assert len(parts) == 3
    assert all(any(line.split()[:1] == ["kernel"] for line in part) for part in parts)
    assert all(any(line.startswith("transform ") for line in part) for part in parts)
    assert [any("of which" in line for line in part) for part in parts] == [True, False, False]  # it has nothing there
    assert any(line.split() == ["transform", "[12.5..1300.25]", "97%"] for line in parts[2])


def test_no_rows() -> None:
    assert printed(WideTable(("a", "b"), ()), 20) == ["a  b"]
