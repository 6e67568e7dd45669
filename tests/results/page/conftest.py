"""A browser, and the report of a module, which it calls ``report``, newly opened in it."""

import pytest
from support.browser import DESKTOP, Browser


@pytest.fixture(scope="module")
def chromium():
    with Browser() as browser:
        yield browser


@pytest.fixture
def page(chromium, report):
    """The report, newly opened on a desktop with light colours."""
    chromium.resize(*DESKTOP)
    chromium.prefer("light")
    chromium.errors.clear()
    chromium.requests.clear()
    chromium.open(report)
    chromium.wait_frames()
    yield chromium
    assert chromium.errors == []
    assert chromium.requests == []
