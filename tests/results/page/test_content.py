import base64
import hashlib
import json
import re
from html.parser import HTMLParser
from importlib.resources import files

import numpy as np
import pytest
from support.reports import VERDICTS, make_report

from ps_fmu.results.page import content, writer
from ps_fmu.results.page.content import Axis, Chart, ChartGroup, Curve, encode
from ps_fmu.results.report import Report

HOSTILE = '</script><script>alert("&")</script><!-- <img src=x onerror=alert(1)>'
PAGE = files(content.__package__)


class Scripts(HTMLParser):
    """The contents of the script elements with their attributes, and whatever attributes start with "on"."""

    def __init__(self):
        super().__init__()
        self.scripts, self.handlers, self.inside, self.tags = [], [], False, []

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.handlers += [name for name, _ in attributes if name.startswith("on")]
        self.inside = tag == "script"
        if self.inside:
            self.scripts.append((dict(attributes), []))

    def handle_endtag(self, tag):
        self.inside = False

    def handle_data(self, data):
        if self.inside:
            self.scripts[-1][1].append(data)


def read(report):
    reader = Scripts()
    page = report.html()
    reader.feed(page)
    reader.close()
    return page, reader, [(attributes, "".join(parts)) for attributes, parts in reader.scripts]


def decode(text):
    return np.frombuffer(base64.b64decode(text), "<f4")


def test_arrays_are_float32_in_base64():
    values = np.array([[1.5, -2.25e-9], [np.nan, 3e7]])
    np.testing.assert_allclose(decode(encode(values)), values.ravel(), rtol=1e-7)


def test_an_even_axis_is_a_start_and_a_step():
    """In float32 the instants of a run of 1000 s at 0.1 ms could not be told apart."""
    packed = Axis("time", "s", 1e-4 * np.arange(10_000_001)[-1000:]).pack()
    assert packed["count"] == 1000
    assert packed["start"] == pytest.approx(999.9001, rel=1e-12)
    assert packed["step"] == pytest.approx(1e-4, rel=1e-9)
    assert "values" not in packed


def test_an_uneven_axis_keeps_its_values():
    values = np.geomspace(0.1, 1000.0, 50)
    packed = Axis("frequency", "Hz", values, logarithmic=True).pack()
    np.testing.assert_allclose(decode(packed["values"]), values, rtol=1e-6)
    assert "start" not in packed


@pytest.mark.parametrize("values", [[], [1.0, 1.0], [2.0, 1.0], [[0.0, 1.0]], [0.0, np.nan]])
def test_an_axis_ascends(values):
    with pytest.raises(ValueError, match="expected ascending values"):
        Axis("time", "s", np.array(values))


def test_a_logarithmic_axis_is_above_zero():
    with pytest.raises(ValueError, match="expected values above 0, got 0"):
        Axis("frequency", "Hz", np.arange(3.0), logarithmic=True)


def test_curves_fit_their_axis_and_have_known_colours():
    with pytest.raises(ValueError, match="chart 'a': expected 3 values of 'b'"):
        ChartGroup("", "", Axis("c", "s", np.arange(3.0)), [Chart("a", "m", [Curve("b", "x", np.zeros(4))])])
    with pytest.raises(ValueError, match=r"curve 'b': expected a colour of passive, .*, got 'red; url"):
        Curve("b", "red; url(x)", np.zeros(4))


def test_verdicts_come_first():
    page, _, _ = read(make_report())
    assert page.index(VERDICTS[0].requirement) < page.index("What was run.") < page.index("1.65e-05")
    cells = re.findall(r"<strong>(.*?)</strong>", page)
    assert cells == ["met", "NOT MET", "cannot be said"]


def test_hostile_names_end_no_script_and_start_none():
    """As component names of a system description may be: in titles, labels and data."""
    _, reader, (data, library, own) = read(make_report(name=HOSTILE))
    assert data[0] == {"type": "application/json", "id": "data"}
    assert library[0] == own[0] == {}
    assert reader.handlers == [] and "img" not in reader.tags
    groups = json.loads(data[1])["charts"]
    assert groups[0]["charts"][0]["title"] == f"{HOSTILE} x"
    assert not set("<>&'") & set(data[1])


def test_the_policy_allows_these_scripts_and_no_others():
    page, _, (_, *scripts) = read(make_report())
    (policy,) = re.findall(r'Content-Security-Policy" content="(.*?)"', page)
    hashes = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for _, text in scripts]
    assert policy.replace("&#39;", "'") == (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src "
        + " ".join(f"'sha256-{value}'" for value in hashes)
    )


def test_a_report_with_nothing_to_explore_has_no_script():
    _, _, scripts = read(Report(title="Empty"))
    assert scripts == []


def test_every_script_of_the_folder_is_in_the_page():
    assert sorted(writer.SCRIPTS) == sorted(path.name for path in PAGE.iterdir() if path.name.endswith(".js"))


@pytest.mark.parametrize("name", [*writer.SCRIPTS, "page.css", "template.html.j2"])
def test_the_pages_files_are_short_and_fetch_nothing(name):
    text = (PAGE / name).read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 400
    assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|eval\(|https?://", text)


def test_the_library_is_the_one_that_was_published():
    vendor = PAGE / "vendor"
    stated = json.loads((vendor / "uPlot.json").read_text())
    for name, checksum in stated["sha256"].items():
        assert hashlib.sha256((vendor / name).read_bytes()).hexdigest() == checksum
    assert f"(v{stated['version']})" in (vendor / "uPlot.iife.min.js").read_text()
    assert "Permission is hereby granted" in (vendor / "uPlot.license").read_text()
    found = {path.name for path in vendor.iterdir()}
    assert found == {*stated["sha256"], "uPlot.json", "uPlot.license"}


def test_no_two_scripts_declare_the_same_name():
    """They are joined into one scope, where a second function silently takes the place of the first."""
    names = re.compile(r"^(?:async )?(?:function\*?|class|const|let|var) +(\w+)", re.MULTILINE)
    found = [
        (name, script)
        for script in writer.SCRIPTS
        for name in names.findall(PAGE.joinpath(script).read_text(encoding="utf-8"))
    ]
    declared = [name for name, _ in found]
    assert len(declared) > 50
    assert [each for each in found if declared.count(each[0]) > 1] == []
