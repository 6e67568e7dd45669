"""The image points of a report in headless Chromium: zoom by drag, wheel, fingers, buttons and keys; read-out."""

import re

import pytest
from support.browser import DESKTOP, INSTALL, PHONE, find_browser
from support.reports import make_report

if find_browser() is None:
    pytest.skip(f"Chromium is not installed: {INSTALL}", allow_module_level=True)

CANVAS = ".cloud canvas"


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    path = tmp_path_factory.mktemp("cloud") / "report.html"
    make_report().write(path)
    return path


@pytest.fixture(params=[DESKTOP, PHONE], ids=["desktop", "phone"])
def page(chromium, report, request):
    """The report, newly opened."""
    chromium.resize(*request.param, mobile=request.param is PHONE)
    chromium.errors.clear()
    chromium.open(report)
    chromium.wait_frames()
    yield chromium
    assert chromium.errors == []


def picture(page, place=0):
    return page.evaluate(f"document.querySelectorAll('{CANVAS}')[{place}].toDataURL()")


def point(page, across=0.5, down=0.5):
    """What the read-out says of a place of the first canvas: x, y, distance, um."""
    left, top, width, height = page.place(CANVAS)
    page.mouse("mouseMoved", left + across * width, top + down * height, buttons=0)
    text = page.text(".cloud .bar .span:last-child").replace("\N{MINUS SIGN}", "-")
    found = re.findall(r"(x|y|distance) (-?[\d.]+) ?(\S*)", text)
    assert [name for name, _, _ in found] == ["x", "y", "distance"]
    scale = {"m": 1e6, "mm": 1e3, "\N{MICRO SIGN}m": 1.0, "nm": 1e-3, "pm": 1e-6}
    return [float(value) * scale[unit or "m"] for _, value, unit in found]


def shown(page):
    """Half of the width that the first canvas shows, um: its plotting area begins 46 px from its edge."""
    _, _, width, _ = page.place(CANVAS)
    right, left = (point(page, 0.5 + side * 0.25, 0.5)[0] for side in (1, -1))
    return (right - left) / 0.5 * (width - 92.0) / width / 2.0


def press(page, label):
    page.evaluate(
        f"[...document.querySelectorAll('.cloud .bar button')].find((e) => e.textContent === '{label}').click()"
    )
    page.wait_frames()


def test_buttons_zoom_both_views_and_show_all_again(page):
    before, whole = (picture(page), picture(page, 1)), shown(page)
    press(page, "+")
    assert shown(page) == pytest.approx(0.5 * whole, rel=0.02)
    assert picture(page) != before[0] and picture(page, 1) != before[1]
    press(page, "\N{MINUS SIGN}")
    assert (picture(page), picture(page, 1)) == before
    for _ in range(40):
        press(page, "+")
    assert 0.0 < shown(page) == pytest.approx(1e-3 * whole, rel=0.05)  # no further
    press(page, "All")
    assert (picture(page), picture(page, 1)) == before


def test_a_drag_shows_the_square_about_it(page):
    whole = shown(page)
    left, top, width, height = page.place(CANVAS)
    other = picture(page, 1)
    x, y = left + 0.55 * width, top + 0.45 * height
    target = point(page, 0.625, 0.375)
    page.mouse("mouseMoved", x, y, buttons=0)
    page.mouse("mousePressed", x, y)
    page.mouse("mouseMoved", left + 0.7 * width, top + 0.3 * height)
    page.wait_frames()
    marked = picture(page)
    page.mouse("mouseReleased", left + 0.7 * width, top + 0.3 * height)
    page.wait_frames()
    assert picture(page) != marked
    assert shown(page) == pytest.approx(0.15 * whole * width / (width - 92.0), rel=0.1)
    assert point(page)[:2] == pytest.approx(target[:2], abs=0.02 * whole)
    assert picture(page, 1) == other  # the other view is another part of the plane


def test_a_click_zooms_nothing_and_a_double_click_shows_all(page):
    before = picture(page)
    page.click(CANVAS)
    assert picture(page) == before
    press(page, "+")
    left, top, width, height = page.place(CANVAS)
    for count in (1, 2):
        for kind in ("mousePressed", "mouseReleased"):
            page.call(
                "Input.dispatchMouseEvent", type=kind, x=left + width / 2, y=top + height / 2, button="left",
                buttons=1, clickCount=count,
            )  # fmt: skip
    page.wait_frames()
    assert picture(page) == before


def test_wheel_with_ctrl_zooms_about_the_pointer(page):
    whole, before = shown(page), point(page, 0.7, 0.6)
    left, top, width, height = page.place(CANVAS)
    at = (left + 0.7 * width, top + 0.6 * height)
    wheel = {"deltaX": 0, "deltaY": -100, "buttons": 0}
    page.mouse("mouseWheel", *at, modifiers=2, **wheel)
    page.wait_frames(4)
    assert shown(page) == pytest.approx(whole / 1.25, rel=0.02)
    assert point(page, 0.7, 0.6) == pytest.approx(before, abs=0.01 * whole)


def test_keys_zoom_and_move(page):
    whole = shown(page)
    page.evaluate(f"document.querySelector('{CANVAS}').focus({{preventScroll: true}})")
    for key in ("+", "+", "ArrowRight", "ArrowUp"):
        page.call("Input.dispatchKeyEvent", type="keyDown", key=key)
    page.wait_frames()
    assert shown(page) == pytest.approx(0.25 * whole, rel=0.02)
    assert point(page)[:2] == pytest.approx([0.125 * whole] * 2, abs=0.01 * whole)
    for _ in range(40):
        page.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowRight")
    page.wait_frames()
    assert point(page)[0] == pytest.approx(0.75 * whole, rel=0.02)  # the edge of what there is
    page.call("Input.dispatchKeyEvent", type="keyDown", key="0")
    page.wait_frames()
    assert shown(page) == pytest.approx(whole, rel=0.01)


def test_two_fingers_zoom(page):
    whole = shown(page)
    page.call("Emulation.setTouchEmulationEnabled", enabled=True)
    left, top, width, height = page.place(CANVAS)
    x, y = left + width / 2, top + height / 2
    page.touch("touchStart", [(x - 20, y), (x + 20, y)])
    for spread in (25, 30, 35, 40):
        page.touch("touchMove", [(x - spread, y), (x + spread, y)])
    page.touch("touchEnd", [])
    page.wait_frames(4)
    page.call("Emulation.setTouchEmulationEnabled", enabled=False)
    assert shown(page) == pytest.approx(0.5 * whole, rel=0.05)
