"""What an analysis prints: nothing is wider than the terminal."""

import pytest

from ps_fmu.paper.analysis_result import AnalysisResult
from ps_fmu.paper.finding import Finding
from ps_fmu.paper.terminal_report import format_result
from ps_fmu.results.tables import Table

TEXT = "A paragraph that says a lot of things about numbers. " * 10
FINDINGS = [
    Finding("table2.nominal_active_2", 3.98e-8, 4.04e-8, "a remark"),
    Finding("table2.nominal_rejection_2", 99.2, 99.18),
    Finding("text.delay", 0.02, setting=True),
]
SMALL = Table("Small", ("a heading that is longer than its column", "b"), [("1", "2")])
WIDE = Table("Wide", tuple("abcdef"), [("x" * 40,) * 6])


@pytest.mark.parametrize("width", [80, 100, 120])
def test_lines_fit(width):
    text = format_result(AnalysisResult("name", "Title", [TEXT], FINDINGS, [SMALL, WIDE]), width)
    assert max(map(len, text.splitlines())) <= width
    assert "In name.md:\n- Wide" in text and "xxx" not in text
    words = " ".join(text.split())
    assert "+111 / +114 %" in words and "input as published" in words
    assert "a remark" not in words and "remarks: name.md" in words
    assert words.count("Table 2: ") == 1


def test_what_is_short_stays_in_one_line():
    table = Table("C", ("a", "b"), [("1", "2"), ("10", "20")])
    text = format_result(AnalysisResult("name", "Title", ["Text."], [], [table]), 80)
    assert text.splitlines() == ["Title", "Text.", "", "C", "a    b", "------", "1    2", "10  20"]
