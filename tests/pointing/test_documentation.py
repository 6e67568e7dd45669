"""docs/pointing.md: its examples print what they say."""

import doctest
from pathlib import Path

DOCUMENT = Path(__file__).parents[2] / "docs" / "pointing.md"


def test_the_examples_print_what_they_say():
    found = doctest.testfile(str(DOCUMENT), module_relative=False)
    assert found.failed == 0
    assert found.attempted >= 25
