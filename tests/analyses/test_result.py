"""Findings beside the published numbers, and how results are written to files and to the terminal."""

import json
import math

import pytest

from ps_fmu.analyses.result import AnalysisResult, PublishedNumber
from ps_fmu.paper.published import make_finding, published_numbers
from ps_fmu.results.tables import Table


def test_every_published_number_is_complete():
    for key, number in published_numbers().items():
        assert number.key == key and number.where and number.what and number.unit
        assert math.isfinite(number.value)
    assert published_numbers()["table1.roll_max"].value == 9.60083


def test_rejections_of_table_2_follow_from_its_rms_values():
    """Within what two and three digits allow, but for the one that the remark is about."""
    for key, number in published_numbers().items():
        if "rejection" not in key or not key.startswith("table2."):
            continue
        passive, active = (published_numbers()[key.replace("rejection", name)].value for name in ("passive", "active"))
        off = abs(100.0 * (1.0 - active / passive) - number.value)
        assert off < (0.1 if number.remark else 0.06), key
        assert bool(number.remark) == (off > 0.06), key


@pytest.mark.parametrize(
    ("key", "ours", "difference"),
    [
        ("table1.roll_max", 9.60093, "+0.0001 deg"),
        ("table2.nominal_passive_1", 1.6665e-5, "+1 %"),
        ("fig8.attenuation", 60.0, "holds"),
        ("fig8.amplification", 9.5, "does not hold"),
        ("fig7.error", 2e-9, "x 0.2"),
    ],
)
def test_difference_from_the_paper(key, ours, difference):
    assert make_finding(key, ours).difference == difference


@pytest.mark.parametrize(
    ("key", "computed", "cosimulated", "difference"),
    [
        ("fig8.attenuation", 60.0, 40.0, "holds / does not hold"),
        ("fig8.attenuation", 60.0, 61.0, "holds"),
        ("fig9.radius_active", 1.1e-7, 1.2e-7, "x 1.1 / x 1.2"),
        ("table2.nominal_passive_1", 1.6665e-5, 1.6335e-5, "+1 / -1 %"),
        ("table2.nominal_rejection_1", 99.4, 99.2, "+0.1 / -0.1 points"),
    ],
)
def test_computed_and_cosimulated_values_are_both_compared(key, computed, cosimulated, difference):
    assert make_finding(key, computed, cosimulated).difference == difference


def test_a_setting_is_not_compared_as_if_it_were_a_result():
    assert make_finding("text.delay", 0.02, setting=True).difference == "as published"
    assert make_finding("text.delay", 0.03, setting=True).difference == "not as published"


def test_what_two_analyses_found_is_joined():
    found = make_finding("table1.roll_max", 9.6, remark="a").join(
        make_finding("table1.roll_max", cosimulated=9.5, remark="b")
    )
    assert found == make_finding("table1.roll_max", 9.6, 9.5, "a; b")


def test_published_numbers_are_in_the_order_of_the_file():
    """Groups are interleaved there, as in the paper."""
    keys = list(published_numbers())
    order = ["text.epsilon", "table1.roll_max", "text.cone", "fig7.error", "text.noise_to", "fig10.OSM_peak"]
    assert sorted(order, key=keys.index) == order


def test_unknown_relations_are_refused():
    with pytest.raises(ValueError, match="relation '!='"):
        PublishedNumber("a.b", "Fig 1", "something", "m", 1.0, relation="!=")


def test_what_is_written(tmp_path):
    table = Table("Other", ("a", "b"), [("1", "2|3")])
    findings = [make_finding("table1.yaw_max", 16.6)]
    AnalysisResult("name", "Title", ["Text."], findings, [table], data={"x": [1.0]}).write(tmp_path)
    content = json.loads((tmp_path / "name.json").read_text())
    assert content["findings"][0]["published"] == 16.6285 and content["x"] == [1.0]
    assert content["tables"] == [{"caption": "Other", "header": ["a", "b"], "rows": [["1", "2|3"]], "notes": []}]
    assert content["title"] == "Title" and content["text"] == ["Text."] and content["pictures"] == []
    markdown = (tmp_path / "name.md").read_text()
    assert "| Table 1 | largest yaw angle | deg | 16.6285 | 16.6 | - | -0.028 deg |  |" in markdown
    assert "2\\|3" in markdown
    assert "Title" in (tmp_path / "name.html").read_text()


TEXT = "A paragraph that says a lot of things about numbers. " * 10
FINDINGS = [
    make_finding("table2.nominal_active_2", 3.98e-8, 4.04e-8, "a remark"),
    make_finding("table2.nominal_rejection_2", 99.2, 99.18),
    make_finding("text.delay", 0.02, setting=True),
]
SMALL = Table("Small", ("a heading that is longer than its column", "b"), [("1", "2")])
WIDE = Table("Wide", tuple("abcdef"), [("x" * 40,) * 6])


@pytest.mark.parametrize("width", [80, 100, 120])
def test_lines_fit(width):
    text = AnalysisResult("name", "Title", [TEXT], FINDINGS, [SMALL, WIDE]).to_text(width)
    assert max(map(len, text.splitlines())) <= width
    assert "In name.md:\n- Wide" in text and "xxx" not in text
    words = " ".join(text.split())
    assert "+111 / +114 %" in words and "input as published" in words
    assert "a remark" not in words and "remarks: name.md" in words
    assert words.count("Table 2: ") == 1


def test_what_is_short_stays_in_one_line():
    table = Table("C", ("a", "b"), [("1", "2"), ("10", "20")])
    text = AnalysisResult("name", "Title", ["Text."], [], [table]).to_text(80)
    assert text.splitlines() == ["Title", "Text.", "", "C", "a    b", "------", "1    2", "10  20"]
