"""What a report costs its reader: size, time to open, frames per second while zooming and while playing.

In headless Chromium, which draws without a graphics card: a screen of today is faster.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from time import perf_counter

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))  # the browser of the tests

from support.browser import INSTALL, Browser, find_browser  # type: ignore[import-not-found]  # noqa: E402

LARGEST_MB, LONGEST_S = 5.0, 3.0
FRAMES = 120

ZOOM = """
(async () => {
  const over = document.querySelector('%s .u-over');
  over.scrollIntoView({block: 'center'});
  const box = over.getBoundingClientRect();
  const place = {clientX: box.left + 0.4 * box.width, clientY: box.top + 0.5 * box.height};
  const begin = performance.now();
  for (let k = 0; k < %d; k++) {
    const deltaY = k %% 40 < 20 ? -100 : 100;
    over.dispatchEvent(new WheelEvent('wheel', {...place, deltaY, ctrlKey: true, bubbles: true, cancelable: true}));
    await new Promise(requestAnimationFrame);
  }
  return (performance.now() - begin) / 1000;
})()
"""
PLAY = """
(async () => {
  document.querySelector('.mechanism canvas').scrollIntoView({block: 'center'});
  const button = document.querySelector('.mechanism .bar button');
  button.click();
  const begin = performance.now();
  for (let k = 0; k < %d; k++) await new Promise(requestAnimationFrame);
  const passed = (performance.now() - begin) / 1000;
  if (button.textContent.includes('Pause')) button.click();
  return passed;
})()
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print; exit code 1 if a report is too large or opens too slowly."""
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    p.add_argument("reports", nargs="+", type=Path, metavar="REPORT.html")
    p.add_argument("--openings", type=int, default=5, metavar="N", help="times each is opened (%(default)s)")
    arguments = p.parse_args(argv)
    if find_browser() is None:
        p.error(f"Chromium is needed: {INSTALL}")
    missed = [str(path) for path in arguments.reports if not measure(path, arguments.openings)]
    if missed:
        print(f"missed ({LARGEST_MB:g} MB, {LONGEST_S:g} s): {', '.join(missed)}")
    return bool(missed)


def measure(report: Path, openings: int) -> bool:
    """Print the figures of a report; False if it misses a target."""
    size = report.stat().st_size / 1e6
    with Browser() as browser:
        times = []
        for _ in range(openings):
            begin = perf_counter()
            browser.open(report)
            browser.wait_frames()
            times.append(perf_counter() - begin)
        opened = f"opens in {median(times):.2f} s (median of {openings}, longest {max(times):.2f} s)"
        figures = [f"{size:.2f} MB", opened]
        for group in range(browser.evaluate("document.querySelectorAll('[data-group]').length")):
            passed = browser.evaluate(ZOOM % (f'[data-group="{group}"]', FRAMES))
            figures.append(f"zoom of charts {group}: {FRAMES / passed:.0f} frames/s")
        if browser.evaluate("document.querySelector('.mechanism') !== null"):
            figures.append(f"play: {FRAMES / browser.evaluate(PLAY % FRAMES):.0f} frames/s")
    print(f"{report}: {'; '.join(figures)}")
    return size < LARGEST_MB and median(times) < LONGEST_S


if __name__ == "__main__":
    sys.exit(main())
