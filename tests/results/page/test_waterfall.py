"""The waterfall of the report in headless Chromium: what is read off, zoomed and drawn."""

import re
from dataclasses import replace

import pytest
from support.browser import DESKTOP, INSTALL, PHONE, find_browser
from support.reports import MODE_HZ, ORDER, TOP_RPM, make_waterfall

from ps_fmu.results.page.content import Exploration
from ps_fmu.results.report import Report

if find_browser() is None:
    pytest.skip(f"Chromium is not installed: {INSTALL}", allow_module_level=True)

SECTION = ".waterfall"
EDGE = {"left": 58, "right": 12, "top": 30, "bottom": 44}  # px, as in waterfall.js
SHOWN_HZ = 1.35 * 141.0  # at first: a third above the highest mode


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    path = tmp_path_factory.mktemp("waterfall") / "report.html"
    Report(title="Wheels", explored=Exploration(waterfalls=[make_waterfall()])).write(path)
    return path


def point(page, frequency, rpm, place=0, shown=(0.0, SHOWN_HZ)):
    """Where a frequency and a speed are in the window, px."""
    page.place(f"{SECTION} canvas")
    box = page.evaluate(
        f"(() => {{ const b = document.querySelectorAll('{SECTION} canvas')[{place}].getBoundingClientRect();"
        " return [b.left, b.top, b.width, b.height]; })()"
    )
    left, top, width, height = map(float, box)
    inner = width - EDGE["left"] - EDGE["right"], height - EDGE["top"] - EDGE["bottom"]
    share = (frequency - shown[0]) / (shown[1] - shown[0])
    return left + EDGE["left"] + share * inner[0], top + EDGE["top"] + (1.0 - rpm / TOP_RPM) * inner[1]


def read(page, *place, **more):
    """What is said of the place under the pointer."""
    page.mouse("mouseMoved", *point(page, *place, **more), buttons=0)
    page.wait_frames()
    return page.text(f"{SECTION} .readout")


def colours(page, frequency, rpm, place=0):
    """Red, green, blue at a place of a panel."""
    x, y = point(page, frequency, rpm, place)
    return page.evaluate(
        f"(() => {{ const c = document.querySelectorAll('{SECTION} canvas')[{place}], b = c.getBoundingClientRect();"
        " const copy = document.createElement('canvas'); copy.width = c.width; copy.height = c.height;"
        " const context = copy.getContext('2d', { willReadFrequently: true }); context.drawImage(c, 0, 0);"
        f" return [...context.getImageData({x} - b.left, {y} - b.top, 1, 1).data].slice(0, 3); }})()"
    )


def test_a_place_is_read_with_what_meets_there(page):
    rpm = 60.0 * MODE_HZ / ORDER
    text = read(page, MODE_HZ, rpm)
    frequency, speed = map(float, re.match(r"([\d.]+) Hz, ([\d.]+) rpm: passive", text).groups())
    assert frequency == pytest.approx(MODE_HZ, abs=1.0) and speed == pytest.approx(rpm, abs=20.0)
    assert "passive 10 \N{MICRO SIGN}rad" in text
    assert f"{ORDER:g} \N{MULTIPLICATION SIGN} wheel_1" in text and "tower mode (60 Hz)" in text
    assert "active 1 \N{MICRO SIGN}rad" in read(page, MODE_HZ, rpm, 1)
    elsewhere = read(page, 20.0, rpm)
    assert "wheel_1" not in elsewhere and "mode" not in elsewhere
    assert "passive 1 nrad" in elsewhere
    assert read(page, -10.0, rpm) == ""  # beside the picture


def test_strong_is_bright_and_weak_is_dark(page):
    line, beside = colours(page, 75.3, 60.0 * 75.3 / ORDER + 15.0), colours(page, 30.0, 5000.0)
    assert sum(line) > 500 > 200 > sum(beside)
    assert sum(colours(page, 75.3, 60.0 * 75.3 / ORDER + 15.0, 1)) < sum(line)


def test_dragging_zooms_both_panels_and_all_is_everything(page):
    before = [page.evaluate(f"document.querySelectorAll('{SECTION} canvas')[{k}].toDataURL()") for k in (0, 1)]
    (x0, y), (x1, _) = point(page, 40.0, 3000.0), point(page, 80.0, 3000.0)
    page.mouse("mouseMoved", x0, y, buttons=0)
    page.mouse("mousePressed", x0, y)
    page.mouse("mouseMoved", x1, y)
    page.mouse("mouseReleased", x1, y)
    page.wait_frames(4)
    after = [page.evaluate(f"document.querySelectorAll('{SECTION} canvas')[{k}].toDataURL()") for k in (0, 1)]
    assert before[0] != after[0] and before[1] != after[1]
    frequency = float(read(page, 60.0, 2400.0, shown=(40.0, 80.0)).split()[0])
    assert frequency == pytest.approx(60.0, abs=0.3)
    page.evaluate(f"document.querySelectorAll('{SECTION} .bar button')[4].click()")
    page.wait_frames(4)
    assert float(read(page, 195.0, 2400.0, shown=(0.0, 200.0)).split()[0]) == pytest.approx(195.0, abs=1.0)


def test_dark_phone_and_print_are_drawn(page, tmp_path):
    light = page.evaluate(f"document.querySelector('{SECTION} canvas').toDataURL()")
    page.prefer("dark")
    page.wait_frames(4)
    assert page.evaluate(f"document.querySelector('{SECTION} canvas').toDataURL()") != light
    page.resize(*PHONE, mobile=True)
    page.wait_frames(4)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    widths = page.evaluate(f"[...document.querySelectorAll('{SECTION} canvas')].map((e) => e.clientWidth)")
    assert all(300 < width < PHONE[0] for width in widths)
    page.resize(*DESKTOP)
    page.prefer("light")
    page.print(tmp_path / "page.pdf")
    assert (tmp_path / "page.pdf").stat().st_size > 10_000


@pytest.mark.parametrize("bare", [{"modes": ()}, {"lines": ()}, {"modes": (), "lines": ()}])
def test_without_modes_or_lines(page, tmp_path, bare):
    shown = replace(make_waterfall(), **bare)
    Report(title="Bare", explored=Exploration(waterfalls=[shown])).write(tmp_path / "report.html")
    page.open(tmp_path / "report.html")
    page.wait_frames()
    assert "passive" in read(page, 60.0, 3000.0, shown=(0.0, shown.shown))


def test_names_are_texts(page, tmp_path):
    hostile = "<img src=x onerror=alert(1)>"
    shown = make_waterfall(name=hostile, case=hostile)
    Report(title="Hostile", explored=Exploration(waterfalls=[shown])).write(tmp_path / "report.html")
    page.open(tmp_path / "report.html")
    page.wait_frames()
    assert hostile in read(page, MODE_HZ, 60.0 * MODE_HZ / ORDER)
    assert page.evaluate("document.querySelectorAll('img').length") == 0
