"""Published logs are read with the numbers of rows that docs/navigation.md has."""

import re

import numpy as np
import pytest

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.navigation.overview import read_navigation
from sonarmap.tools.files.readers.navigation.settings import NavigationSettings
from tests.samples.places import DATA, ROOT

ROW = re.compile(r"\| `([\w.-]+\.(?:csv|log|sbet))` \| ([\d,]+|refused) \|")
LOGS = dict(ROW.findall((ROOT / "docs" / "navigation.md").read_text(encoding="utf-8")))


def test_ten_logs_are_listed() -> None:
    assert len(LOGS) == 10


@pytest.mark.parametrize("name", LOGS)
def test_a_real_log_has_its_rows(name: str) -> None:
    path = DATA / "real" / "navigation" / name
    if not path.is_file():
        pytest.skip("shared/data/real/navigation is not beside the checkout")
    notes = list[str]()
    if LOGS[name] == "refused":
        with pytest.raises(InputError, match=r"has no sentence with .* \d+ [A-Z]{3,}"):
            read_navigation(path, NavigationSettings(), None, np.zeros(0), notes)
        return
    assert f"{len(read_navigation(path, NavigationSettings(), None, np.zeros(0), notes).lines):,}" == LOGS[name]
