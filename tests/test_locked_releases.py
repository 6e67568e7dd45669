"""What ``make`` installs: the releases of constraints.txt, each file known by its SHA-256."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
RELEASE = re.compile(r"^([a-z0-9._-]+)==(\S+)", re.MULTILINE)


def read_releases(name):
    """Version by package, as a file of the project's root pins them."""
    return dict(RELEASE.findall((ROOT / name).read_text(encoding="utf-8")))


def test_locked_releases_are_those_of_the_constraints():
    locked, known = read_releases("requirements-dev.txt"), read_releases("constraints.txt")
    assert locked.items() <= known.items()
    assert {"numpy", "fmpy", "pythonfmu", "pytest", "setuptools"} <= locked.keys()


def test_each_locked_release_has_hashes():
    text = (ROOT / "requirements-dev.txt").read_text(encoding="utf-8")
    entries = re.split(r"(?m)^(?=[a-z0-9])", text)[1:]
    assert len(entries) == len(read_releases("requirements-dev.txt"))
    assert [entry.split()[0] for entry in entries if not re.search(r"--hash=sha256:[0-9a-f]{64}\b", entry)] == []
