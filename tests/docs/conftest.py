"""The documentation site, built once: with the tutorials, which are executed."""

import re
import subprocess
import sys
from dataclasses import dataclass, field
from functools import cached_property
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest

ROOT = Path(__file__).parents[2]


@dataclass
class Page(HTMLParser):
    """A page of the site: its anchors, its links, its rows of tables."""

    path: Path
    anchors: set[str] = field(default_factory=set)
    links: list[str] = field(default_factory=list)
    rows: list[list[str]] = field(default_factory=list)

    def __post_init__(self):
        super().__init__()
        self._cell = None
        self.text = self.path.read_text(encoding="utf-8")
        self.feed(self.text)

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.anchors |= {given[key] for key in ("id", "name") if given.get(key)}
        self.links += [given[key] for key in ("href", "src") if given.get(key)]
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self._cell = []

    def handle_endtag(self, tag):
        if tag in ("td", "th") and self._cell is not None:
            self.rows[-1].append("".join(self._cell).strip())
            self._cell = None

    def handle_data(self, data):
        if self._cell is not None:
            self._cell.append(data)


@dataclass(frozen=True)
class Site:
    """The built site."""

    folder: Path
    source: Path
    messages: str

    @cached_property
    def pages(self):
        """All pages by their paths in the site."""
        paths = sorted(path for path in self.folder.rglob("*.html") if "_static" not in path.parts)
        return {path.relative_to(self.folder).as_posix(): Page(path) for path in paths}

    def outputs(self, tutorial):
        """What a tutorial printed, as one text."""
        text = (self.source / "docs" / "tutorials" / "made" / f"{tutorial}.rst").read_text(encoding="utf-8")
        return "\n".join(re.findall(r"\.\. code-block:: none\n\n((?:    .*\n|\n)+)", text))

    def find_broken(self, page):
        """Links of a page to files or anchors of the site that do not exist."""
        broken = []
        for link in page.links:
            target, _, anchor = link.partition("#")
            if re.match(r"[a-z]+:|//", target):
                continue
            path = page.path.parent / unquote(target.split("?")[0]) if target else page.path
            found = path.resolve().is_relative_to(self.folder) and path.is_file()
            if found and anchor and path.suffix == ".html":
                name = path.resolve().relative_to(self.folder).as_posix()
                found = unquote(anchor) in self.pages[name].anchors
            if not found:
                broken.append(link)
        return broken


@pytest.fixture(scope="session")
def site(built_fmus, tmp_path_factory):
    """The site as ``make docs`` makes it; a warning fails it."""
    output = tmp_path_factory.mktemp("site").resolve() / "docs"
    command = [sys.executable, ROOT / "docs" / "site" / "build.py", "--output", output, "--fmus", built_fmus]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-5000:]
    return Site(output, output.with_name("docs-source"), done.stderr)
