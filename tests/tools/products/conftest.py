"""Closes the browsers that the tests of this folder share."""

from collections.abc import Iterator

import pytest

from tests.tools.products.report.browser import end_browsers


@pytest.fixture(scope="package", autouse=True)
def _browsers() -> Iterator[None]:
    yield
    end_browsers()
