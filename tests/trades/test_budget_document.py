"""docs/budget.md: its example prints what it says."""

import doctest
from pathlib import Path

DOCUMENT = Path(__file__).parents[2] / "docs" / "budget.md"


def test_the_example_prints_what_it_says():
    found = doctest.testfile(str(DOCUMENT), module_relative=False)
    assert found.failed == 0
    assert found.attempted >= 12
