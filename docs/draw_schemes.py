"""Draws schemes.png: the error of each scheme over the step, and prints the orders as the table of docs/any-system.md.

Usage: python docs/draw_schemes.py [OUTPUT.png|OUTPUT.svg]

The FMUs are exact within their steps, so that all of the error is the coupling's.  They are compiled by the machine's C
compiler, or ziglang.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))  # the FMUs of the tests

from support.linear import make_oscillator, make_quarter_truck, run  # noqa: E402

from ps_fmu.cosim import Scheme  # noqa: E402

SYSTEMS = {
    "two-mass oscillator": (make_oscillator, ("first.x", "second.F"), 2.0),  # end of the run, s
    "quarter truck": (make_quarter_truck, ("chassis.z", "wheel.F"), 1.0),
}
STEPS = {  # s
    "two-mass oscillator": (1 / 50, 1 / 100, 1 / 200, 1 / 400),
    "quarter truck": (1 / 200, 1 / 400, 1 / 800, 1 / 1600),
}
SCHEMES = [
    *((order, way) for order in ("jacobi", "gauss-seidel") for way in ("hold", "linear", "smoothed")),
    ("iterated", "hold"),
    ("iterated", "linear"),
]
COLOURS = {"jacobi": "#D55E00", "gauss-seidel": "#0072B2", "iterated": "#009E73"}
LINES = {"hold": "-", "linear": "--", "smoothed": ":"}


def measure(steps=STEPS):
    """Errors (schemes, steps) of each system: the largest in the second half of the run, over the largest value."""
    found = {}
    for name, (make, outputs, end) in SYSTEMS.items():
        with tempfile.TemporaryDirectory() as folder:
            system = make().build(Path(folder))
            found[name] = np.array(
                [[find_error(make(), system, Scheme(*s), h, end, outputs) for h in steps[name]] for s in SCHEMES]
            )
    return found


def find_error(coupled, system, scheme, h, end, outputs):
    """The error of one run with steps of h, s."""
    rows = run(system, scheme, h, end)
    exact = coupled.solve(rows.time)
    half = len(rows.time) // 2
    return max(np.abs(rows[n] - exact[n])[half:].max() / np.abs(exact[n]).max() for n in outputs)


def list_rows(found, steps=STEPS):
    """Rows of the table: scheme, then the order and the error with the longest step in each system."""
    for place, (order, way) in enumerate(SCHEMES):
        cells = []
        for name, errors in found.items():
            slope = np.polyfit(np.log(steps[name]), np.log(errors[place]), 1)[0]
            cells += [f"{slope:.2f}", f"{errors[place][0]:.1e}"]
        yield f"| {order}, {way} | " + " | ".join(cells) + " |"


def draw(path, found, steps=STEPS):
    """Write the drawing to ``path``; the suffix gives the format."""
    with rc_context({"svg.hashsalt": "schemes", "font.family": "DejaVu Sans", "font.size": 9}):
        figure = Figure(figsize=(9.0, 3.6), dpi=100, layout="constrained")
        for axes, (name, errors) in zip(figure.subplots(1, len(found), squeeze=False)[0], found.items(), strict=True):
            for (order, way), values in zip(SCHEMES, errors, strict=True):
                axes.loglog(
                    steps[name], values, LINES[way], color=COLOURS[order], marker="o", ms=3, label=f"{order}, {way}"
                )
            axes.set_title(name)
            axes.set_xlabel("communication step (ms)")
            axes.set_xticks(steps[name], [f"{1e3 * h:.3g}" for h in steps[name]])
            axes.xaxis.minorticks_off()
            axes.grid(True, alpha=0.25)
            axes.set_ylabel("largest error / largest value")
        figure.legend(*axes.get_legend_handles_labels(), loc="outside right center", frameon=False)
        figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)


if __name__ == "__main__":
    study = measure()
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("schemes.png"), study)
    print("\n".join(list_rows(study)))
