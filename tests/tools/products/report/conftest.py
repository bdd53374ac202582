"""What the pages of all tests show."""

import pytest

from sonarmap.tools.products.report.content import Content
from tests.tools.products.report.known_map import known_content


@pytest.fixture(scope="package")
def content(tmp_path_factory: pytest.TempPathFactory) -> Content:
    """A map of points that are known."""
    return known_content(tmp_path_factory.mktemp("known") / "out")
