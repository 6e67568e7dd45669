"""The report in headless Chromium: what a reader does with it, and that it asks nobody for anything."""

import math
import re

import pytest
from support.browser import INSTALL, PHONE, find_browser
from support.reports import LINE_HZ, PEAK_S, make_dull_report, make_report

if find_browser() is None:
    pytest.skip(f"Chromium is not installed: {INSTALL}", allow_module_level=True)

HISTORIES, SPECTRA = "[data-group='0']", "[data-group='1']"
FIRST = f"{HISTORIES} .chart:nth-child(1)"
CANVASES = ".mechanism canvas"
DARK, LIGHT = "rgb(21, 24, 28)", "rgb(255, 255, 255)"


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    make_report().write(path)
    return path


def span(page, group=HISTORIES):
    """The range that a group says it shows."""
    first, last = re.match(r"([\d.]+) to ([\d.]+) ", page.text(f"{group} .bar .span")).groups()
    return float(first), float(last)


def hover(page, chart, share):
    """Point at a share of a chart's width; what the charts of its group say."""
    left, top, width, height = page.place(f"{chart} .u-over")
    page.mouse("mouseMoved", left + share * width, top + height / 2, buttons=0)
    page.wait_frames()
    group = chart.split()[0]
    return page.evaluate(f'[...document.querySelectorAll("{group} .readout")].map((e) => e.textContent)')


def picture(page, selector, place=0):
    """What a canvas shows, as a text that differs when it does."""
    return page.evaluate(f"document.querySelectorAll({selector!r})[{place}].toDataURL()")


def background(page):
    return page.evaluate("getComputedStyle(document.body).backgroundColor")


def test_it_is_drawn(page):
    sections = page.evaluate("[...document.querySelectorAll('section')].map((e) => e.className)")
    assert sections == ["verdicts", "charts", "charts", "cloud", "mechanism"]
    assert page.evaluate("document.querySelectorAll('.uplot canvas').length") == 6
    assert page.evaluate("document.querySelectorAll('.cloud canvas').length") == 2
    assert span(page) == (0.0, 20.0)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_a_million_values_are_drawn_from_a_few_thousand_and_keep_their_peak(page, tmp_path):
    make_report(count=1_000_001).write(tmp_path / "report.html")
    page.open(tmp_path / "report.html")
    page.wait_frames()
    near = [hover(page, FIRST, PEAK_S / 20.0 + 1e-3 * k)[0] for k in range(-2, 3)]  # the cursor is on whole pixels
    assert any("\N{HORIZONTAL ELLIPSIS} 50 \N{MICRO SIGN}rad" in text for text in near), near


def test_dragging_zooms_all_charts_of_the_group(page):
    before = picture(page, f"{HISTORIES} canvas", 2)
    page.drag(f"{FIRST} .u-over", 0.25, 0.5)
    first, last = span(page)
    assert (first, last) == (pytest.approx(5.0, abs=0.1), pytest.approx(10.0, abs=0.1))
    assert picture(page, f"{HISTORIES} canvas", 2) != before
    assert span(page, SPECTRA) == (0.1, 1000.0)


def test_the_cursor_reads_all_charts_at_one_time(page):
    page.drag(f"{FIRST} .u-over", 0.6, 0.62)
    texts = hover(page, FIRST, 0.5)
    assert len(texts) == 3 and all("passive" in text and "active" in text for text in texts)
    times = [float(text.split()[0]) for text in texts]
    assert times == [pytest.approx(12.2, abs=0.05)] * 3
    # Zoomed in so far, a pixel holds one value: a sine of 1e-5 rad at 1 Hz.
    value, unit = re.search(r"passive (\S+) (\S+)", texts[0]).groups()
    assert float(value.replace("\N{MINUS SIGN}", "-")) == pytest.approx(
        10.0 * math.sin(2.0 * math.pi * times[0]), abs=0.05
    )
    assert unit == "\N{MICRO SIGN}rad"


def test_a_line_of_the_spectrum_is_read_off(page):
    share = math.log10(LINE_HZ / 0.1) / 4.0
    texts = hover(page, f"{SPECTRA} .chart:nth-child(1)", share)
    found = re.search(r"at ([\d.]+) Hz", texts[0])
    assert float(found[1]) == pytest.approx(LINE_HZ, rel=2e-3)


def test_wheel_buttons_and_keys_zoom_and_move(page):
    left, top, width, height = page.place(f"{FIRST} .u-over")
    wheel = {"deltaX": 0, "deltaY": -100, "buttons": 0}
    page.mouse("mouseWheel", left + width / 2, top + height / 2, **wheel)
    page.wait_frames(4)
    assert span(page) == (0.0, 20.0)  # a plain wheel scrolls the page
    page.place(f"{FIRST} .u-over")
    page.mouse("mouseWheel", left + width / 2, top + height / 2, modifiers=2, **wheel)
    page.wait_frames(4)
    assert span(page) == (pytest.approx(2.0, abs=0.1), pytest.approx(18.0, abs=0.1))
    press_all(page)
    assert span(page) == (0.0, 20.0)
    page.evaluate(f"document.querySelector('{FIRST.replace(chr(39), chr(34))}').focus()")
    for key in ("+", "+", "ArrowRight"):
        page.call("Input.dispatchKeyEvent", type="keyDown", key=key)
    page.wait_frames()
    assert span(page) == (8.75, 13.75)


def press_all(page):
    page.evaluate("[...document.querySelectorAll('.bar button')].find((e) => e.textContent === 'All').click()")
    page.wait_frames()


def test_the_range_ends_where_the_run_does(page):
    page.evaluate(f"document.querySelector('{FIRST.replace(chr(39), chr(34))}').focus()")
    for key in ("-", "ArrowLeft", *["+"] * 20, *["ArrowRight"] * 400):
        page.call("Input.dispatchKeyEvent", type="keyDown", key=key)
    page.wait_frames(4)
    first, last = span(page)
    assert 0.0 < last - first < 0.05 and first >= 0.0 and last <= 20.0


def test_a_curve_is_hidden_and_shown(page):
    assert "passive" in hover(page, FIRST, 0.4)[0]
    page.click(f"{HISTORIES} .bar button.curve")
    text = hover(page, FIRST, 0.4)[0]
    assert "passive" not in text and "active" in text and "nrad" in text
    page.click(f"{HISTORIES} .bar button.curve")
    assert "passive" in hover(page, FIRST, 0.4)[0]


def test_the_mechanism_plays(page):
    start = picture(page, CANVASES), picture(page, CANVASES, 1)
    page.click(".mechanism .bar button")
    page.evaluate("new Promise((done) => setTimeout(done, 300))")
    page.click(".mechanism .bar button")
    clock = float(page.text(".mechanism output").removesuffix(" s"))
    assert 0.1 < clock < 19.0
    assert picture(page, CANVASES, 1) == start[1]  # this motion is none
    stopped = picture(page, CANVASES)
    page.wait_frames(10)
    assert picture(page, CANVASES) == stopped
    page.evaluate(
        "(() => { const e = document.querySelector('.mechanism input'); e.value = 3.25;"
        " e.dispatchEvent(new Event('input')); })()"
    )
    assert page.text(".mechanism output") == "3.25 s"
    assert picture(page, CANVASES) not in {start[0], stopped}


def test_the_mechanism_turns_with_the_mouse(page):
    start = picture(page, CANVASES), picture(page, CANVASES, 1)
    page.drag(CANVASES, 0.3, 0.6)
    assert picture(page, CANVASES) != start[0]
    assert picture(page, CANVASES, 1) != start[1]  # one camera looks at both
    page.evaluate("[...document.querySelectorAll('.bar button')].find((e) => e.textContent === 'Reset view').click()")
    assert (picture(page, CANVASES), picture(page, CANVASES, 1)) == start


def choose(page, theme):
    page.evaluate(
        f"(() => {{ const e = document.getElementById('theme'); e.value = '{theme}';"
        " e.dispatchEvent(new Event('change')); })()"
    )


def test_dark_as_the_system_is_and_as_the_reader_chooses(page):
    light = picture(page, f"{HISTORIES} canvas"), picture(page, CANVASES)
    assert background(page) == LIGHT
    page.prefer("dark")
    page.wait_frames()
    assert background(page) == DARK
    assert picture(page, f"{HISTORIES} canvas") != light[0] and picture(page, CANVASES) != light[1]
    choose(page, "light")
    page.wait_frames()
    assert background(page) == LIGHT
    assert (picture(page, f"{HISTORIES} canvas"), picture(page, CANVASES)) == light
    page.prefer("light")
    choose(page, "dark")
    assert background(page) == DARK


def test_a_phone_shows_all_within_its_width_a_tap_reads_and_two_fingers_zoom(page, report):
    page.resize(*PHONE, mobile=True)
    page.open(report)
    page.wait_frames()
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE[0]
    edges = "[...document.querySelectorAll('section, canvas, h1, h2')].map((e) => e.getBoundingClientRect().right)"
    assert max(page.evaluate(edges)) <= PHONE[0] + 1
    left, top, width, height = page.place(f"{FIRST} .u-over")
    x, y = left + width / 2, top + height / 2
    page.touch("touchStart", [(x, y)])
    page.touch("touchEnd", [])
    page.wait_frames(30)  # a tap becomes a click a little later
    assert "passive" in page.text(f"{FIRST} .readout")
    left, top, width, height = page.place(f"{FIRST} .u-over")
    x, y = left + width / 2, top + height / 2
    page.touch("touchStart", [(x - 20, y), (x + 20, y)])
    for spread in (25, 30, 35, 40):
        page.touch("touchMove", [(x - spread, y), (x + spread, y)])
    page.touch("touchEnd", [])
    page.wait_frames(4)
    first, last = span(page)
    assert (first + last) / 2 == pytest.approx(10.0, abs=0.5)
    assert last - first == pytest.approx(10.0, abs=0.5)


def test_it_prints_light_and_goes_on_as_it_was(page, tmp_path):
    page.prefer("dark")
    page.wait_frames()
    dark = picture(page, f"{HISTORIES} canvas")
    seen = "getComputedStyle(document.documentElement).getPropertyValue('--text')"
    page.evaluate(
        "(() => { window.seen = []; addEventListener('beforeprint', () => { window.seen ="
        f" [{seen}, document.querySelector('.uplot canvas').toDataURL()]; }}); }})()"
    )
    page.print(tmp_path / "report.pdf")
    page.wait_frames(4)
    assert (tmp_path / "report.pdf").read_bytes().startswith(b"%PDF")
    colour, printed = page.evaluate("window.seen")
    assert colour == "#222222" and printed != dark
    assert picture(page, f"{HISTORIES} canvas") == dark


@pytest.mark.parametrize("value", [0.0, 1e-7, math.nan])
@pytest.mark.parametrize("count", [1, 2, 9])
def test_a_run_of_next_to_nothing_is_shown(page, tmp_path, count, value):
    """One instant, nothing that moves, no value at all: every control still works."""
    make_dull_report(count, value).write(tmp_path / "report.html")
    page.open(tmp_path / "report.html")
    page.evaluate("[...document.querySelectorAll('.bar button')].forEach((button) => button.click())")
    page.wait_frames(4)
    texts = [hover(page, f"[data-group='{group}'] .chart", 0.5)[0] for group in (0, 1)]
    assert [re.match(r"[1-9][.\d]* s", text) is not None for text in texts] == [True, True], texts


HOSTILE = "</script><script>document.title = 'taken'</script><img src=x onerror=\"document.title='taken'\">"


def test_hostile_names_stay_names(page, tmp_path):
    make_report(name=HOSTILE).write(tmp_path / "report.html")
    page.open(tmp_path / "report.html")
    page.wait_frames()
    assert page.evaluate("document.title") == HOSTILE
    assert page.text(f"{HISTORIES} h3") == f"{HOSTILE} x"
    assert page.evaluate("document.querySelectorAll('img').length") == 0
    assert HOSTILE in page.text(".cloud .bar")
