"""docs/paper, made by `ps-fmu analyse paper`, is what is true today.

Markdown and JSON say the same.  Closed forms are computed anew, and findings, errata, text and tables compared with
them.  Findings of runs of the FMUs are compared with the closed form; for text and tables the runs are those of the
data in the JSON files.  Not compared: captions of figures, and columns whose numbers the data have not.
"""

import numpy as np
import pytest
from support import published as stored_runs
from support.claims import verify_claim
from support.published import FOLDER, PARTS, alike, content_of, finding_of, read_result

from ps_fmu.mechanism.parameters import load
from ps_fmu.paper import overview
from ps_fmu.paper.bus_cases import CASES
from ps_fmu.paper.errata import Erratum, errata_table
from ps_fmu.paper.figures import fig06 as workspace
from ps_fmu.paper.figures.fig06 import compute_reach
from ps_fmu.paper.figures.fig07 import report as trajectories
from ps_fmu.paper.figures.fig08_11 import report as transmissibility
from ps_fmu.paper.figures.fig08_11.measured import Setup
from ps_fmu.paper.figures.fig10 import report as stability
from ps_fmu.paper.figures.fig10.closed_form import judge
from ps_fmu.paper.figures.fig10.runs import SHAKING
from ps_fmu.paper.figures.table2 import report as jitter
from ps_fmu.paper.figures.table2.runs import ORIENTATIONS, nominal_densities
from ps_fmu.paper.published import published_numbers
from ps_fmu.results.tables import Table
from ps_fmu.runs.scenario import SCENARIOS
from ps_fmu.scenarios.shaking import Shaking
from ps_fmu.theory.transmissibility import singular_values_db

NAMES = (*PARTS, "paper")
#: Closed form today against closed form then: what other versions of the libraries may change.
RELATIVE = 1e-3
ABSOLUTE = {"deg": 1e-5, "dB": 1e-3, "Hz": 1e-3, "%": 1e-3}  # in the unit of the number, if that is less
NOISE = {"fig11.similar": 1e-9, "fig11.similar_damped": 1e-9}  # dB: differences of equal curves
ROUNDING = 1e-12  # relative, in the evidence of errata; deg, errors of exact inverse kinematics
#: Errors of the right forms are rounding, or of a search: (41), (42).
RIGHT = 1e-6


def wrong(stored, today):
    """Keys of the stored findings whose computed value is not today's."""
    return [key for key, finding in stored.items() if not _same(key, finding.computed, today[key].computed)]


def _same(key, then, now):
    if then is None or now is None:
        return then is now
    tolerance = NOISE.get(key, min(RELATIVE * abs(now), ABSOLUTE.get(published_numbers()[key].unit, np.inf)))
    return abs(then - now) <= tolerance


@pytest.fixture(scope="module")
def stored():
    """The findings of docs/paper by key."""
    return {entry["key"]: finding_of(entry) for entry in content_of("paper")["findings"]}


@pytest.mark.parametrize("name", NAMES)
def test_the_markdown_is_what_the_json_says(name):
    content = content_of(name)
    assert read_result(name, PARTS if name == "paper" else ()).to_markdown() == (FOLDER / f"{name}.md").read_text()
    for entry in content["findings"]:
        finding = finding_of(entry)
        said = finding.published
        assert (entry["where"], entry["what"], entry["unit"]) == (said.where, said.what, said.unit)
        assert (entry["published"], entry["relation"]) == (said.value, said.relation)
        assert entry["difference"] == finding.difference, finding.key


def test_the_table_has_all_numbers_and_those_of_the_parts(stored):
    assert list(stored) == list(published_numbers())
    for name in PARTS:
        for entry in content_of(name)["findings"]:
            part, whole = finding_of(entry), stored[entry["key"]]
            assert part.computed in (None, whole.computed), entry["key"]
            assert part.cosimulated in (None, whole.cosimulated), entry["key"]
            assert part.remark in whole.remark


def test_what_is_computed_is_computed_today(stored, closed_form):
    verify_claim(
        "paper.computed",
        claim="The computed values beside the published ones are those of today",
        where="`ps-fmu analyse paper`, docs/paper",
        reference="computed anew by the test",
        error=len(wrong(stored, closed_form)),
        bound=0,
        unit="values that differ",
    )
    for key, finding in closed_form.items():
        assert alike(finding.remark, stored[key].remark) or finding.remark == "", key
        assert finding.setting == stored[key].setting


def test_errata_are_those_of_today(all_errata):
    content = content_of("paper")
    stored = [Erratum(**entry) for entry in content["errata"]]
    table = errata_table(stored)
    assert Table(**content["tables"][-1]).to_markdown() == table.to_markdown()
    assert [e.equation for e in stored] == [e.equation for e in all_errata]
    for then, now in zip(stored, all_errata, strict=True):
        assert (then.printed, then.unit) == (now.printed, now.unit)
        assert alike(then.evidence, now.evidence, ROUNDING) and alike(then.right, now.right), then.equation
        assert (then.error_right is None) == (now.error_right is None)
        assert abs((then.error_right or 0.0) - (now.error_right or 0.0)) < RIGHT, then.equation
        assert (then.error_printed is None) == (now.error_printed is None)
        assert then.error_printed == (now.error_printed and pytest.approx(now.error_printed, rel=1e-2)), then.equation


def test_the_runs_agree_with_the_closed_form(stored, with_step):
    """Each co-simulated value: with that for the communication step where it counts, else with the computed one."""
    off = []
    for key, finding in stored.items():
        if finding.cosimulated is None:
            continue
        expected, tolerance = with_step.get(key, (finding.computed, None))
        if tolerance is None:
            tolerance = 1e-2 * abs(expected)
            if finding.published.unit == "dB":
                tolerance = 0.2
            elif finding.published.unit == "deg":  # phases, as measured; angles of the platform, to rounding
                tolerance = 0.5 if key.startswith("fig10.") else min(1e-9, tolerance)
        off.append(abs(finding.cosimulated - expected) / tolerance)
    verify_claim(
        "paper.cosimulated",
        claim="Co-simulated values beside the computed ones",
        where="`ps-fmu analyse paper`, docs/paper: table of all published numbers",
        reference="closed form with the delay of a communication step: 67 values to 1 %, 0.2 dB, 0.5 deg",
        error=off,
        bound=1.0,
        unit="of what is allowed",
    )


@pytest.fixture(scope="module")
def with_step(jitter_results):
    """Closed form with the delay of the communication step, and tolerance, by key: Table 2, Fig 9, Fig 8."""
    found = {}
    rejections = {}
    for name, result in jitter_results.items():
        passive, active = (found_of_lines.rms for found_of_lines in result.lines)
        rejections[name] = 100.0 * (1.0 - active / passive)
        for i in range(3):
            found[f"table2.{name}_passive_{i + 1}"] = passive[i], 1e-2 * passive[i]
            found[f"table2.{name}_active_{i + 1}"] = active[i], 1e-2 * active[i]
            found[f"table2.{name}_rejection_{i + 1}"] = rejections[name][i], 0.05
    for k, what in enumerate(("passive", "active")):
        radius = jitter_results["nominal"].lines[k].radius_rms
        found[f"fig9.radius_{what}"] = radius, 1e-2 * radius
        largest = max(result.lines[k].rms.max() for result in jitter_results.values())
        found[f"text.jitter_{what}"] = largest, 1e-2 * largest
    found["text.rejection"] = min(values.min() for values in rejections.values()), 0.05
    shaking = Shaking()
    passive, active = (
        np.array([
            singular_values_db(Setup(name, active=on).closed_form(shaking.lines, shaking.step))[:, 0]
            for name in ORIENTATIONS
        ])
        for on in (False, True)
    )  # fmt: skip
    found["fig8.start"] = max(passive[:, 0], key=abs), 0.02
    found["fig8.attenuation"] = (passive - active).max(axis=1).min(), 0.1
    return found


@pytest.fixture(scope="module")
def today(curves, jitter_results):
    """Paragraphs and tables of each analysis."""
    reach = compute_reach()
    measured, of_step = stored_runs.agreements()
    delay = published_numbers()["text.delay"].value
    verdicts = {case: judge(case, delay) for case in CASES}
    limits_s = {case: verdict.delay_limit for case, verdict in verdicts.items()}
    seen = (
        verdicts, stored_runs.open_loops(SHAKING.lines), stored_runs.responses(limits_s, SCENARIOS["stability"].step_s)
    )  # fmt: skip
    limits, beyond = stored_runs.limit_results(trajectories.extremes()[0])
    densities = nominal_densities(load(), SCENARIOS["table2"].step_s)
    return {
        "workspace": (workspace.paragraphs(reach), workspace.tables(reach)),
        "trajectories": (
            trajectories.paragraphs(stored_runs.path_results(), beyond),
            [None, trajectories.limit_table(limits, beyond)],  # the first has a test of its own
        ),
        "transmissibility": (
            transmissibility.paragraphs(measured), transmissibility.tables(*curves, measured, of_step),
        ),
        "stability": (stability.paragraphs(*seen), stability.tables(*seen)),
        "jitter": (jitter.paragraphs(jitter_results, densities), jitter.tables(jitter_results, densities)),
    }  # fmt: skip


def differences(content, today):
    """Paragraphs, captions, headers and rows that are not those of today; ``content`` of a JSON file."""
    text, tables = today
    rounding = ROUNDING if content["analysis"] == "trajectories" else 0.0
    pairs = [([one], [other]) for one, other in zip(content["text"], text, strict=True)]
    for then, now in zip(content["tables"], tables, strict=True):
        if now is not None:
            shown = [[now.caption], now.header, *now.rows]
            pairs += zip([[then["caption"]], then["header"], *then["rows"]], shown, strict=True)
    return [
        then
        for then, now in pairs
        if len(then) != len(now) or not all(alike(*cells, rounding) for cells in zip(then, now, strict=True))
    ]


@pytest.mark.parametrize("name", PARTS)
def test_text_and_tables_are_those_of_today(today, name):
    assert differences(content_of(name), today[name]) == []


def test_the_error_table_of_the_trajectories():
    rows = content_of("trajectories")["tables"][0]["rows"]
    results = stored_runs.path_results()
    assert [tuple(row[:2]) for row in rows] == [(r.path, r.method) for r in results]
    for row, result in zip(rows, results, strict=True):
        assert row[4] == f"{np.degrees(result.error.max()):.1e}"


def test_remarks_of_table_2_are_those_of_today(stored, jitter_results):
    """With what the runs gave; the second axis is not reproduced, and each active row of it says so."""
    for finding in jitter.findings(jitter_results):
        assert alike(finding.remark, stored[finding.key].remark), finding.key
        assert finding.cosimulated == pytest.approx(stored[finding.key].cosimulated, rel=1e-9), finding.key
    for name in ORIENTATIONS:
        assert stored[f"table2.{name}_active_2"].remark.startswith("not reproduced: ")


def test_text_of_the_whole():
    content = content_of("paper")
    expected = overview.paragraphs(
        [finding_of(entry) for entry in content["findings"]], [Erratum(**entry) for entry in content["errata"]]
    )
    assert content["text"] == expected and content["not_computed"] == []


def test_the_pictures_are_those_of_the_report():
    shown = [picture["file"] for picture in content_of("paper")["pictures"]]
    assert sorted(shown) == sorted(path.name for path in FOLDER.glob("*.png"))
