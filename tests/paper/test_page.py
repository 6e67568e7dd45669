"""paper.html in headless Chromium, made from the results that are kept in docs/paper."""

from itertools import pairwise

import pytest
from support.browser import INSTALL, Browser, find_browser
from support.published import PARTS, read_result

if find_browser() is None:
    pytest.skip(f"Chromium is not installed: {INSTALL}", allow_module_level=True)

WIDTHS = pytest.mark.parametrize("width", [390, 800, 1400])


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """A folder with the pages of the overview and of its parts."""
    folder = tmp_path_factory.mktemp("pages")
    overview = read_result("paper", PARTS)
    for result in (overview, *overview.parts):
        result.write(folder)
    return folder


@pytest.fixture(scope="module")
def browser():
    with Browser() as browser:
        yield browser


@pytest.fixture
def page(browser, pages, request):
    """The page in a window of a width, px."""
    width = request.getfixturevalue("width") if "width" in request.fixturenames else 1400
    browser.resize(width, 900, mobile=width < 500)
    browser.errors.clear()
    browser.requests.clear()
    browser.open(pages / "paper.html")
    yield browser
    assert browser.errors == browser.requests == []


@WIDTHS
def test_every_remark_is_within_the_window(page, width):
    """No cell of the tables of numbers and errata lies beside it, and none is empty space that hides the text."""
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    outside = """[...document.querySelectorAll('.wide td')].filter((cell) => {
      const box = cell.getBoundingClientRect();
      return cell.textContent && (box.left < 0 || box.right > document.documentElement.clientWidth || !box.height);
    }).map((cell) => cell.textContent)"""
    assert page.evaluate(outside) == []
    remarks = "[...document.querySelectorAll('#section-1 td:last-child')].map((cell) => cell.textContent)"
    kept = read_result("paper")
    assert page.evaluate(remarks) == [row[-1] for row in kept.all_tables()[0].rows]
    assert sum(map(bool, page.evaluate(remarks))) > 30


@WIDTHS
def test_text_is_as_wide_as_it_needs(page, width):
    """A remark is no column of single words."""
    widths = "[...document.querySelectorAll('.wide td:last-child')].filter((e) => e.textContent)"
    assert page.evaluate(f"Math.min(...{widths}.map((e) => e.getBoundingClientRect().width))") > 150


def test_the_contents_lead_to_headings(page):
    links = page.evaluate("[...document.querySelectorAll('.contents a')].map((a) => [a.hash.slice(1), a.textContent])")
    titles = [read_result(part).title for part in PARTS]
    assert [text for _, text in links] == ["The paper's numbers", "Errata", *titles, "Origin"]
    assert len({name for name, _ in links}) == len(links)
    for name, text in links:
        page.click(f".contents a[href='#{name}']")
        top, found = page.evaluate(
            f"(() => {{ const e = document.getElementById('{name}'); const h = e.matches('h2') ? e : "
            "e.querySelector('h2'); return [h.getBoundingClientRect().top, h.textContent]; })()"
        )
        assert found == text
        assert 0.0 <= top < 900.0


def test_headings_are_in_order(page):
    levels = page.evaluate("[...document.querySelectorAll('h1, h2, h3')].map((e) => Number(e.tagName[1]))")
    assert levels[0] == 1 and levels.count(1) == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))


def test_links_lead_to_pages_that_are_there(page, pages):
    links = page.evaluate("[...document.querySelectorAll('a')].map((a) => a.getAttribute('href'))")
    files = [link for link in links if not link.startswith("#")]
    assert files == [f"{part}.html" for part in PARTS]
    assert all((pages / name).is_file() for name in files)
    assert page.evaluate("[...document.images].every((image) => image.complete && image.naturalWidth > 0)")
