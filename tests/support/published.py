"""docs/paper as it is stored: the JSON files of the analyses, and runs of the FMUs rebuilt from what these say."""

import json
import re
from decimal import Decimal
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from ps_fmu.analyses.result import AnalysisResult
from ps_fmu.paper.figures.fig07.runs import FINE
from ps_fmu.paper.figures.fig08_11.measured import SETUPS
from ps_fmu.paper.published import make_finding
from ps_fmu.results.report import Picture
from ps_fmu.results.tables import Table

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "paper"
PARTS = ("workspace", "trajectories", "transmissibility", "stability", "jitter")
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")


def content_of(name):
    """What NAME.json holds."""
    return json.loads((FOLDER / f"{name}.json").read_text())


def finding_of(entry):
    """A finding of a JSON file."""
    return make_finding(entry["key"], entry["computed"], entry["cosimulated"], entry["remark"], entry["setting"])


def read_result(name, parts=()):
    """The result of an analysis, and of those that it puts together, as when it was written."""
    content = content_of(name)
    return AnalysisResult(
        name=name,
        title=content["title"],
        text=content["text"],
        findings=list(map(finding_of, content["findings"])),
        tables=[Table(**table) for table in content["tables"]],
        pictures=[Picture(FOLDER / picture["file"], picture["caption"]) for picture in content["pictures"]],
        parts=list(map(read_result, parts)),
    )


def alike(one, other, rounding=0.0):
    """Whether texts are the same but for two per cent of the numbers in them, or one of the last digit of fractions.

    ``rounding``: numbers this small are, and any will do.
    """
    return NUMBER.sub("#", one) == NUMBER.sub("#", other) and all(
        abs(float(a) - float(b)) <= 0.02 * abs(float(a)) + _last_digit(a) + rounding
        for a, b in zip(NUMBER.findall(one), NUMBER.findall(other), strict=True)
    )


def _last_digit(text):
    exponent = Decimal(text).as_tuple().exponent
    return 10.0**exponent if exponent < 0 else 0.0


# --- Runs, as far as texts and tables need them ---------------------------------------------------------------------


def jitter_run():
    """The co-simulation of Table 2, by orientation."""
    content = content_of("jitter")
    largest = iter(row[4] for row in content["tables"][3]["rows"])  # m: the tables alone have it
    found = {}
    for name, entry in content["orientations"].items():
        scatters = {
            case: SimpleNamespace(
                radius_rms=entry[f"image_rms_radius_{case}_m"],
                radius_max=float(next(largest)),
                hull_area=entry[f"image_hull_area_{case}_m2"],
            )
            for case in ("passive", "active")
        }
        found[name] = SimpleNamespace(
            **{
                case: SimpleNamespace(
                    scatter=scatter,
                    statistics=SimpleNamespace(
                        std=np.array(entry[f"cosimulated_{case}_rad"]), mean=np.array(entry[f"mean_{case}_rad"])
                    ),
                )
                for case, scatter in scatters.items()
            },
        )
    return found


def agreements():
    """The measured transmissibility, by setup, and that with the isolator against three closed forms."""

    def agreement(entry):
        return SimpleNamespace(
            checked=np.ones(entry["lines_checked"], int),
            within=np.ones(entry["lines"], int),
            lowest_coherence=entry["lowest_coherence"],
            largest_db=np.array(entry["largest_deviation_db"]),
            largest_deg=np.array(entry["largest_deviation_deg"]),
            holds=entry["within_0.2_db_and_2_deg"],
        )

    content = content_of("transmissibility")
    measured = dict(zip(SETUPS, map(agreement, content["measured"]), strict=True))
    assert [(list(s.rpy_deg), s.case, s.mode) for s in SETUPS] == [
        (entry["orientation_deg"], entry["case"], entry["isolator"]) for entry in content["measured"]
    ]
    return measured, {name: agreement(e) for name, e in content["measured_active_by_closed_form"].items()}


def open_loops(frequency):
    """The measured open loops by case; ``frequency`` of the lines (n,), Hz."""
    return {
        case: SimpleNamespace(
            values=np.ones(entry["lines"]),
            checked=np.ones(entry["lines_checked"], int),
            deviation=(entry["largest_deviation_db"], entry["largest_deviation_deg"]),
            response=SimpleNamespace(frequency=frequency, coherence=np.array([entry["lowest_coherence"]])),
            margins=SimpleNamespace(
                largest_gain_db=entry["largest_gain_db"], largest_gain_at=entry["largest_gain_at_hz"]
            ),
        )
        for case, entry in content_of("stability")["open_loop"].items()
    }


def responses(limits_s, step_s):
    """The time responses; ``limits_s`` of the delay by case, communication step ``step_s``."""
    return [
        SimpleNamespace(
            case=entry["case"],
            enabled=entry["isolator"],
            delay_s=entry["delay_s"],
            pole=complex(*entry["pole_rad_s"]),
            predicted=complex(*entry["predicted_pole_rad_s"]),
            growth=entry["last_second_over_first"],
            stable=entry["stable"],
            rms=entry["payload_rms_rad"],
            loop=SimpleNamespace(delay=(entry["delay_s"] or 0.0) + step_s, delay_limit=limits_s[entry["case"]]),
        )
        for entry in content_of("stability")["responses"]
    ]


def path_results():
    """The paths of Fig 7, as far as their largest errors go, and the smallest one with the finer limit."""
    content = content_of("trajectories")
    smallest = next(e["cosimulated"] for e in content["findings"] if e["key"] == "fig7.smallest_error")  # deg
    found = []
    for name, largest in content["largest_error_deg"].items():
        path, _, method = name.partition(", ")
        errors = [smallest, largest] if method == FINE else [largest]
        found.append(SimpleNamespace(path=path, method=method, error=np.radians(errors)))
    return found


def limit_results(targets):
    """What was reached of the limits of Table 1, ``targets`` (6, 3), rad, and what was refused beyond."""
    content = content_of("trajectories")
    reached = np.radians(content["limits_reached_deg"])
    error = np.abs(reached - targets).max(axis=1)
    return (
        SimpleNamespace(target=targets, response=reached, error=error),
        SimpleNamespace(refused=np.array(content["beyond_refused"])),
    )
