"""Text and tables of docs/paper are those of today.

Closed forms are computed anew.  What comes from runs of the FMUs is taken from the data of the JSON files: text and
tables must say what these do, and the findings of the runs are compared with the closed form in
test_published_result.py.  Not compared are captions of figures, and of the error table of the trajectories what the
data have not.
"""

import re

import numpy as np
import pytest
from support import published
from support.published import alike, content_of, finding_of

from ps_fmu.analysis import jitter, paper, stability_report, trajectories, transmissibility, workspace
from ps_fmu.analysis.errata import Erratum
from ps_fmu.analysis.open_loop import SHAKING
from ps_fmu.analysis.stability import judge
from ps_fmu.manipulator.parameters import load
from ps_fmu.paper import published as published_numbers
from ps_fmu.scenarios.options import DEFAULT_STEP_S
from ps_fmu.scenarios.support_modules import CASES
from ps_fmu.scenarios.table2_theory import ORIENTATIONS

ROUNDING = {"trajectories": 1e-12}  # deg: errors of exact inverse kinematics


@pytest.fixture(scope="module")
def today(curves, jitter_results):
    """Paragraphs and tables of each analysis."""
    reach = workspace.compute()
    measured, of_step = published.agreements()
    delay = published_numbers()["text.delay"].value
    verdicts = {case: judge(case, delay) for case in CASES}
    limits_s = {case: verdict.delay_limit for case, verdict in verdicts.items()}
    seen = (
        verdicts, published.open_loops(SHAKING.lines), published.responses(limits_s, DEFAULT_STEP_S["stability"])
    )  # fmt: skip
    limits, beyond = published.limit_results(trajectories.extremes()[0])
    densities = jitter.nominal_densities(load(), DEFAULT_STEP_S["table2"])
    return {
        "workspace": (workspace.paragraphs(reach), workspace.tables(reach)),
        "trajectories": (
            trajectories.paragraphs(published.path_results(), beyond), [None, trajectories.limit_table(limits, beyond)],
        ),
        "transmissibility": (
            transmissibility.paragraphs(measured), transmissibility.tables(*curves, measured, of_step),
        ),
        "stability": (stability_report.paragraphs(*seen), stability_report.tables(*seen)),
        "jitter": (jitter.paragraphs(jitter_results, densities), jitter.tables(jitter_results, densities)),
    }  # fmt: skip


def differences(content, today):
    """Paragraphs, captions, headers and rows that are not those of today; ``content`` of a JSON file."""
    text, tables = today
    rounding = ROUNDING.get(content["analysis"], 0.0)
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


@pytest.mark.parametrize("name", paper.PARTS)
def test_text_and_tables_are_those_of_today(today, name):
    assert differences(content_of(name), today[name]) == []


@pytest.mark.parametrize("name", paper.PARTS)
def test_any_other_text_would_be_noticed(today, name):
    """A number five per cent off, in each paragraph and in each row of a table that has one; and other words."""
    content = content_of(name)
    changed = [(content["text"], k) for k in range(len(content["text"]))]
    for table, now in zip(content["tables"], today[name][1], strict=True):
        if now is not None:
            changed += [(row, k) for row in table["rows"] for k in range(len(row))]
    for place, k in changed:
        before = place[k]
        others = [before + " not"]
        if (number := re.search(r"(?<![\d.])[1-9]\d*\.\d{2,}(?!e)", before)) is not None:
            more = f"{1.05 * float(number[0]) + 0.1:.{len(number[0].partition('.')[2])}f}"
            others.append(before[: number.start()] + more + before[number.end() :])
        for other in others:
            place[k] = other
            assert len(differences(content, today[name])) == 1, other
        place[k] = before


def test_the_error_table_of_the_trajectories():
    rows = content_of("trajectories")["tables"][0]["rows"]
    results = published.path_results()
    assert [tuple(row[:2]) for row in rows] == [(r.path, r.method) for r in results]
    for row, result in zip(rows, results, strict=True):
        assert row[4] == f"{np.degrees(result.error.max()):.1e}"


def test_remarks_of_table_2_are_those_of_today(jitter_results):
    """With what the runs gave; the second axis is not reproduced, and each active row of it says so."""
    stored = {entry["key"]: finding_of(entry) for entry in content_of("paper")["findings"]}
    for finding in jitter.findings(jitter_results):
        assert alike(finding.remark, stored[finding.key].remark), finding.key
        assert finding.cosimulated == pytest.approx(stored[finding.key].cosimulated, rel=1e-9), finding.key
    for name in ORIENTATIONS:
        assert stored[f"table2.{name}_active_2"].remark.startswith("not reproduced: ")


def test_text_of_the_whole(today):
    content = content_of("paper")
    parts = [content_of(name) for name in paper.PARTS]
    expected = paper.paragraphs(
        [finding_of(entry) for entry in content["findings"]],
        [paper.Analysis(part["analysis"], part["title"], part["text"]) for part in parts],
        [Erratum(**entry) for entry in content["errata"]],
    )
    assert content["text"] == expected


def test_counts_of_the_readme_are_those_of_the_report():
    counted = content_of("paper")["text"][0]
    readme = " ".join((published.ROOT / "README.md").read_text().split())
    said = re.search(r"(\d+) numbers of the paper beside ours \((\d+) of them computed and co-simulated\)", readme)
    assert said.groups() == (
        re.search(r"has (\d+) numbers", counted)[1], re.search(r"for (\d+) there is a value from", counted)[1]
    )  # fmt: skip
