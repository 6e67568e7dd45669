"""The built site: links, FMU pages, tutorials; it opens without a network, on a phone as well."""

import re
import sys
import zipfile
from pathlib import Path
from xml.etree.ElementTree import fromstring

import pytest
from support.browser import DESKTOP, INSTALL, PHONE, Browser, find_browser
from support.models import MODELS

ROOT = Path(__file__).parents[2]
TUTORIALS = sorted(path.stem for path in (ROOT / "docs" / "tutorials").glob("plot_*.py"))
EQUATIONS = ("docs/physics", *(f"fmus/{folder}/README" for folder in MODELS.values()))
OPENED = ("index.html", "docs/tutorials/made/plot_1_first_run.html", "fmus/manipulator_plant/README.html",
          "docs/physics.html", "docs/api/pointing.html", "docs/commands.html")  # fmt: skip
WIDTH = (1400, 900)  # px, of a window on a desktop


def test_it_is_built_without_a_warning(site):
    assert "WARNING" not in site.messages
    assert len(site.pages) > 45


def test_all_links_within_the_site_lead_somewhere(site):
    broken = {name: links for name, page in site.pages.items() if (links := site.find_broken(page))}
    assert broken == {}


def test_all_documents_are_pages(site):
    documents = [*ROOT.glob("docs/**/*.md"), *ROOT.glob("fmus/**/README.md")]
    documents = [path.relative_to(ROOT) for path in documents if path.parent.name != "paper"]
    names = {path.with_suffix(".html").as_posix() for path in documents}
    assert names - {"docs/index.html"} <= site.pages.keys()


def test_the_user_has_twenty_pages_in_five_groups(site):
    """In the order of the sidebar, on each page; what lies below a page, and for developers, does not count."""
    for name in ("index.html", "docs/api/run.html"):
        groups = site.pages[name].text.partition("bd-docs-nav")[2].partition("</nav>")[0]
        assert len(re.findall('class="caption"', groups)) == 5
        assert len(re.findall(r'<li class="toctree-l1', groups)) == 20


def test_texts_of_links_are_no_names_of_files(site):
    named = re.compile(r"<a[^>]*>(?:<[^>]*>)*[\w./-]+\.(?:md|rst)(?:<[^>]*>)*</a>")
    assert {name: found for name, page in site.pages.items() if (found := named.findall(page.text))} == {}


def test_nothing_is_loaded_from_elsewhere(site):
    loaded = re.compile(
        r"<(?:script|img|iframe|source)[^>]*\ssrc=\"(?:https?:)?//|<link(?![^>]*canonical)[^>]*\shref=\"(?:https?:)?//"
    )
    assert [name for name, page in site.pages.items() if loaded.search(page.text)] == []
    assert not [
        path for path in site.folder.rglob("*.css") if re.search(r"url\(['\"]?(?:https?:)?//", path.read_text())
    ]


def test_nothing_tells_of_the_machine(site):
    told = [str(ROOT), str(Path.home()), str(site.folder.parents[1]), sys.prefix, "site-packages", "/tmp/"]
    files = [
        path for path in site.folder.rglob("*") if path.suffix in {".html", ".js", ".txt", ".json", ".py", ".ipynb"}
    ]
    files = [path for path in files if "_static" not in path.parts]
    assert len(files) > 80
    found = {path.name: [word for word in told if word in path.read_text(encoding="utf-8")] for path in files}
    assert {name: words for name, words in found.items() if words} == {}


@pytest.mark.parametrize("model", MODELS)
def test_the_page_of_an_fmu_has_what_its_description_says(site, built_fmus, model):
    with zipfile.ZipFile(built_fmus / f"{model}.fmu") as archive:
        description = fromstring(archive.read("modelDescription.xml"))
        icon = archive.read("model.png")
    page = site.pages[f"fmus/{MODELS[model]}/README.html"]
    rows = [dict(zip(header, row, strict=True)) for header, row in headed(page.rows) if header[0] == "Name"]
    shown = {row["Name"].partition(".")[2]: row for row in rows if "Start" in row or "Unit" in row or "Type" in row}
    variables = {
        variable.get("name"): variable
        for variable in description.iter("ScalarVariable")
        if variable.get("causality") != "local"  # states of the linear model and their rates: not on the page
    }
    assert shown.keys() == variables.keys()
    for name, variable in variables.items():
        row, kind = shown[name], variable[0]
        assert row.get("Type", "Real") == kind.tag
        if variable.get("causality") != "parameter":
            assert row.get("Variability", "continuous") == variable.get("variability")
        assert row["Description"] == variable.get("description")
        assert row.get("Unit", "") == kind.get("unit", "")
        if kind.tag == "Real" and kind.get("start"):
            assert float(row["Start"]) == pytest.approx(float(kind.get("start")), rel=5e-6)
        else:
            assert row.get("Start", "") == kind.get("start", "").strip()
    facts = dict(row for row in page.rows if len(row) == 2)
    assert facts.items() >= description.find("CoSimulation").attrib.items()
    assert facts["fmiVersion"] == "2.0"
    pictures = [link for link in page.links if link.endswith(".png")]
    assert icon in [(page.path.parent / picture).read_bytes() for picture in pictures]


def headed(rows):
    """Each row of tables with the header of its table: a row that begins with a word of headers."""
    header = None
    for row in rows:
        if row and row[0] in ("Name", "Attribute"):
            header = row
        elif header is not None and len(row) == len(header):
            yield header, row


@pytest.mark.parametrize("name", EQUATIONS)
def test_equations_are_drawn_by_the_browser_itself(site, name):
    blocks = (ROOT / f"{name}.md").read_text(encoding="utf-8").count("```math")
    page = site.pages[f"{name}.html"]
    assert len(re.findall(r'<math[^>]*display="block"', page.text)) == blocks
    assert not [link for link in page.links if "mathjax" in link.lower()]


@pytest.mark.parametrize("name", TUTORIALS)
def test_tutorials_were_run(site, name):
    """Each prints; its pictures are there, and not those that stand for a missing one."""
    script = (ROOT / "docs" / "tutorials" / f"{name}.py").read_text(encoding="utf-8")
    page = site.pages[f"docs/tutorials/made/{name}.html"]
    assert site.outputs(name).strip()
    pictures = {link for link in page.links if f"sphx_glr_{name}_0" in link}
    assert len(pictures) == script.count("plt.subplots(") + script.count("result.plot(")
    assert all((page.path.parent / picture).stat().st_size > 10_000 for picture in pictures)


def numbers(pattern, text):
    """The numbers that a pattern with one group finds."""
    return [float(found) for found in re.findall(pattern, text)]


def test_what_the_tutorials_say_is_true(site):
    """The sentences beside the numbers: isolators isolate, one's own instrument meets, a C program agrees."""
    assert min(numbers(r"([\d.]+) % less", site.outputs("plot_1_first_run"))) > 97.0
    mine = site.outputs("plot_2_my_instrument")
    before, after = numbers(r"all alike +([\d.]+) ", mine)
    assert before < 1.0 < 12.0 < after
    assert re.findall(r"(\d) of 3 are met", mine) == ["3", "3"]
    assert re.search(r"payload_rotation\.y +[\d.]+ urad +[\d.]+ +\d+ % sine 1", mine)
    assert re.search(r" 1 urad +12 of 16 ", mine), "a delay of 4 ms is too much"
    ours, own = numbers(r"payload_rotation\.x +active +([\d.]+) ", mine)
    assert (round(ours, 2), round(own, 2)) == (0.51, 0.38)  # urad
    differences = numbers(r"difference:? ([\de.+-]+)", site.outputs("plot_3_c_program"))
    assert differences and max(differences) < 1e-9


@pytest.fixture(scope="module")
def browser():
    if find_browser() is None:
        pytest.skip(f"Chromium is not installed: {INSTALL}")
    with Browser() as opened:
        yield opened


@pytest.mark.parametrize("name", OPENED)
def test_pages_open_without_a_network(site, browser, name):
    browser.errors.clear()
    browser.requests.clear()
    browser.open(site.folder / name)
    assert browser.errors == []
    assert browser.requests
    assert [address for address in browser.requests if not address.startswith(site.folder.as_uri())] == []


def test_pages_and_code_fit_the_window(site, browser):
    """All pages of the site: neither the page nor a block of code needs a scroll bar to the side."""
    browser.resize(*WIDTH)
    wide = {}
    for name, page in site.pages.items():
        browser.open(page.path)
        found = browser.evaluate(
            "[document.scrollingElement, ...document.querySelectorAll('pre')]"
            ".filter(e => e.scrollWidth > e.clientWidth)"
            ".map(e => e.textContent.split('\\n').reduce((a, b) => a.length > b.length ? a : b).slice(0, 150))"
        )
        if found:
            wide[name] = found
    browser.resize(*DESKTOP)
    assert wide == {}


@pytest.mark.parametrize("name", OPENED)
def test_no_page_is_wider_than_a_phone(site, browser, name):
    browser.resize(*PHONE, mobile=True)
    browser.open(site.folder / name)
    wide = browser.evaluate("document.scrollingElement.scrollWidth - document.documentElement.clientWidth")
    browser.resize(*DESKTOP)
    assert wide <= 0


@pytest.mark.parametrize(
    ("words", "title"),
    [("requirement", "Requirements and verdicts"), ("trilateration", "PointingCommander"),
     ("isolator.filters.highpass_frequency", "FeedforwardIsolator")],
)  # fmt: skip
def test_the_search_finds_the_page(site, browser, words, title):
    """Among the first three."""
    browser.open(site.folder / "search.html")
    listed = browser.evaluate(
        f"(async () => {{ Search.performSearch('{words}'); const found = () =>"
        " [...document.querySelectorAll('#search-results li a')].map(a => a.textContent); let last = -1;"
        " for (let k = 0; k < 200 && (!found().length || found().length !== last); k++)"
        " { last = found().length; await new Promise(f => setTimeout(f, 50)); } return found(); })()"
    )
    assert title in listed[:3]
