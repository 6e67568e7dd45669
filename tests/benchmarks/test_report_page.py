import subprocess
import sys
from pathlib import Path

import pytest
from support.browser import INSTALL, find_browser
from support.reports import make_report

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "report_page.py"


@pytest.mark.skipif(find_browser() is None, reason=f"Chromium is not installed: {INSTALL}")
def test_the_figures_of_a_report_are_printed(tmp_path):
    """How fast it is depends on the machine: only a size that misses its target is judged here."""
    make_report(count=2000).write(tmp_path / "small.html")
    (tmp_path / "large.html").write_text((tmp_path / "small.html").read_text() + " " * 5_000_000)
    command = [sys.executable, "-I", str(SCRIPT), "--openings", "1", *map(str, sorted(tmp_path.iterdir()))]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 1, done.stderr
    large, small, missed = done.stdout.splitlines()
    for line in (large, small):
        assert line.count("frames/s") == 3 and "opens in" in line and " MB" in line
    assert missed.startswith("missed") and str(tmp_path / "large.html") in missed
