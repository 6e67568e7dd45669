"""The cases of a study in headless Chromium: point, choose, sort, filter, keep; and what goes into the page."""

import numpy as np
import pytest
from support.browser import INSTALL, PHONE, find_browser
from support.reports import FAILED, make_case_report, make_cases

from ps_fmu.results.page import cases
from ps_fmu.results.page.cases import CaseColumn, CaseTable
from ps_fmu.results.page.content import Exploration
from ps_fmu.results.report import Report

pytestmark = pytest.mark.skipif(find_browser() is None, reason=f"Chromium is not installed: {INSTALL}")


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    path = tmp_path_factory.mktemp("cases") / "study.html"
    make_case_report().write(path)
    return path


def listed(page):
    """The numbers of the cases in the table, in its order."""
    return page.evaluate("[...document.querySelectorAll('.cases tbody tr')].map((e) => Number(e.dataset.case))")


def choose(page, name, text):
    """Choose an option of a selector by its text."""
    page.evaluate(
        f"(() => {{ const e = document.querySelector('.cases select[name={name}]');"
        f" e.value = [...e.options].find((o) => o.textContent === {text!r}).value;"
        " e.dispatchEvent(new Event('change')); })()"
    )
    page.wait_frames()


def search(page, text):
    page.evaluate(
        f"(() => {{ const e = document.querySelector('.cases input'); e.value = {text!r};"
        " e.dispatchEvent(new Event('input')); })()"
    )
    page.wait_frames()


def press(page, column):
    """Press the heading of a column, by its number."""
    page.evaluate(f"document.querySelectorAll('.cases th button')[{column}].click()")
    page.wait_frames()


def picture(page, place):
    return page.evaluate(f"document.querySelectorAll('.cases canvas')[{place}].toDataURL()")


def point_at_worst(page, kind="mouseMoved", **more):
    """Point at case 5, the highest of all: at its place by the ranges that the scatter pads by 4 %."""
    shown = make_cases()
    mass, blur = shown.parameters[0].values, shown.metrics[0].values
    there = np.isfinite(blur)
    x, y = ((v[5] - v[there].min()) / np.ptp(v[there]) for v in (mass, blur))
    left, top, width, height = page.place(".cases .u-over")
    place = [(0.04 + share) / 1.08 for share in (x, y)]
    at = left + place[0] * width, top + (1.0 - place[1]) * height
    page.mouse(kind, *at, **more)
    page.wait_frames()


def test_pointing_at_a_case_names_it_and_its_command(page):
    assert page.text(".cases .readout") == ""
    point_at_worst(page, buttons=0)
    text = page.text(".cases .readout")
    assert text.startswith("case 5 ")
    assert "900 nrad" in text and "payload.mass" in text
    assert text.endswith("ps-fmu sweep study.toml --case 5 --output results/study")


def test_a_click_keeps_a_case_and_another_one_lets_it_go(page):
    point_at_worst(page, buttons=0)
    for kind in ("mousePressed", "mouseReleased"):
        point_at_worst(page, kind)
    page.mouse("mouseMoved", 5, 5, buttons=0)
    page.wait_frames()
    assert page.text(".cases .readout").startswith("case 5 ")
    assert page.evaluate("document.querySelector('.cases tr.pinned').dataset.case") == "5"
    for kind in ("mousePressed", "mouseReleased"):
        point_at_worst(page, kind)
    assert page.evaluate("document.querySelector('.cases tr.pinned')") is None


def test_the_worst_come_first_and_a_heading_sorts(page):
    shown = make_cases()
    blur, mass = shown.metrics[0].values, shown.parameters[0].values
    worst = np.argsort(-np.where(np.isfinite(blur), blur, -np.inf), kind="stable")[:100]
    assert listed(page) == worst.tolist()
    press(page, 1)
    assert listed(page)[:3] == np.argsort(blur)[:3].tolist()
    press(page, 2)
    assert listed(page)[:3] == np.argsort(-mass)[:3].tolist()
    press(page, 0)
    press(page, 0)
    assert listed(page)[:3] == [0, 1, 2]


def test_the_table_is_filtered(page):
    shown = make_cases()
    blur, mass = shown.metrics[0].values, shown.parameters[0].values
    choose(page, "which", "above the limit")
    assert sorted(listed(page)) == np.flatnonzero(blur > 5e-7).tolist()
    choose(page, "which", "without a result")
    assert listed(page) == [FAILED]
    assert "failed: the model broke" in page.text(".cases tbody")
    choose(page, "which", "all cases")
    search(page, "mass > 51.9")
    assert sorted(listed(page)) == np.flatnonzero(mass.astype("f4") > 51.9).tolist()
    search(page, "blur < 300")  # nrad, as the heading says
    assert sorted(listed(page)) == np.flatnonzero(blur < 3e-7).tolist()
    search(page, "17")
    assert listed(page) == [17]
    search(page, "colour > 1")
    assert listed(page) == []
    assert page.text(".cases .list .span") == "0 of 0 shown"


def test_other_columns_are_drawn(page):
    before = [picture(page, place) for place in (0, 1)]
    choose(page, "over", "isolator.mode")
    assert picture(page, 0) != before[0] and picture(page, 1) == before[1]
    choose(page, "metric", "noise")
    assert picture(page, 1) != before[1]
    assert "noise" in page.text(".cases thead")
    page.evaluate("document.querySelector('.ranking button').click()")  # the strongest
    page.wait_frames()
    assert page.evaluate("document.querySelector('.cases select[name=over]').selectedOptions[0].text") == "payload.mass"


def test_the_ranking_has_the_strongest_first(page):
    names = page.evaluate(
        "[...document.querySelectorAll('.ranking button')]"
        ".map((e) => [e.children[0].textContent, e.children[1].firstChild.style.width, e.children[2].textContent])"
    )
    assert names == [["payload.mass", "90%", "90 %, rising"], ["isolator.mode", "0%", "not above 5 %"]]
    assert page.text(".ranking p") == "What is left: 8 % by the seed."


def test_the_distribution_is_shown_as_shares(page):
    before = picture(page, 1)
    page.click(".cases .bar > button")
    assert page.text(".cases .bar > button") == "Histogram"
    assert picture(page, 1) != before
    page.click(".cases .bar > button")
    assert picture(page, 1) == before


def test_it_fits_a_phone_and_dark_colours(page):
    before = picture(page, 0)
    page.prefer("dark")
    page.wait_frames()
    assert picture(page, 0) != before
    page.resize(*PHONE, mobile=True)
    page.wait_frames(4)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_hostile_names_are_texts(chromium, tmp_path):
    name = '<img src=x onerror=alert(1)></script><script>alert("&")</script>'
    make_case_report(20, name).write(tmp_path / "study.html")
    chromium.errors.clear()
    chromium.open(tmp_path / "study.html")
    chromium.wait_frames()
    assert chromium.errors == []
    assert chromium.evaluate("document.querySelector('img')") is None
    assert name in chromium.text(".cases thead")


def test_cases_without_any_spread_are_drawn(chromium, tmp_path):
    column = CaseColumn("a", "1", np.ones(3))
    metric = CaseColumn("b", "m", np.zeros(3), limit=1.0)
    table = CaseTable("Cases", "", [column], [metric], "rank correlation", ("c", ""))
    Report(title="Dull", explored=Exploration(cases=table)).write(tmp_path / "study.html")
    chromium.errors.clear()
    chromium.open(tmp_path / "study.html")
    chromium.wait_frames()
    assert chromium.errors == []
    assert len(listed(chromium)) == 3


def test_a_large_study_keeps_its_worst_cases_in_the_page(monkeypatch):
    monkeypatch.setattr(cases, "MOST_CASES", 50)
    chosen = make_cases(300).choose()
    assert len(chosen) <= 50 and {5, FAILED} <= set(chosen.tolist())
    assert np.ptp(chosen) > 250 and (np.diff(chosen) > 0).all()
    assert make_cases(40).choose().tolist() == list(range(40))


def test_columns_have_a_value_for_each_case():
    column = CaseColumn("a", "1", np.ones(3))
    with pytest.raises(ValueError, match="column 'b': expected 3 values"):
        CaseTable("", "", [column], [CaseColumn("b", "1", np.ones(2))], "", ("", ""))
    with pytest.raises(ValueError, match="column 'b': expected 1 ranks"):
        CaseTable("", "", [column], [CaseColumn("b", "1", np.ones(3), ranking=[1.0, 2.0])], "", ("", ""))
