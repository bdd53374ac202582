"""The content of the tests' pages; closes the browsers that the tests of this folder share."""

from collections.abc import Iterator

import pytest

from sonarmap.tools.products.report.content import Content
from tests.tools.products.report.browser import end_browsers
from tests.tools.products.report.known_map import known_content


@pytest.fixture(scope="package", autouse=True)
def _browsers() -> Iterator[None]:
    yield
    end_browsers()


@pytest.fixture(scope="package")
def content(tmp_path_factory: pytest.TempPathFactory) -> Content:
    """Content of a map of known points."""
    return known_content(tmp_path_factory.mktemp("known") / "out")
