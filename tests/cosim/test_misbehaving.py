"""What the user sees of FMUs that misbehave, in processes of their own and inside that of the master.

The FMU goes wrong in the step from 0.05 s on, so six rows are complete before, or in another call.
docs/developers/master.md has the same cases as a table.
"""

import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from support import faulty
from support.faulty.cases import ALL, HANG_IN_CALL, HANG_IN_STEP, INSIDE, ISOLATED, UNLIMITED

DRIVE = Path(faulty.__file__).with_name("drive.py")
DOCUMENT = Path(__file__).parents[2] / "docs" / "developers" / "master.md"


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """What was seen, by fault and where it was: all runs in four goes, so that the package is imported four times.

    Three of them are those that wait for a time-out, most of them asleep.
    """
    folder = tmp_path_factory.mktemp("faulty")
    faulty.build(folder)
    cases = [f"{fault}:{where}" for where, table in ALL.items() for fault in table]
    waiting = [f"{fault}:isolated" for faults in (HANG_IN_CALL, HANG_IN_STEP) for fault in sorted(faults)]
    goes = [*(waiting[place::3] for place in range(3)), [case for case in cases if case not in waiting]]
    with ThreadPoolExecutor(len(goes)) as pool:
        found = [one for go in pool.map(lambda go: drive(folder, go), goes) for one in go]
    assert sorted(one["case"] for one in found) == sorted(cases)
    return {one["case"]: one for one in found}


def drive(folder, cases):
    lines = subprocess.run(
        [sys.executable, str(DRIVE), str(folder), *cases], check=True, capture_output=True, text=True
    ).stdout.splitlines()
    return [json.loads(line) for line in lines]


def check(found, expected):
    rows, words, code = expected
    assert found["code"] == code
    report = found["report"] or {}
    if rows is not None:
        assert report["rows"] == rows
    text = "\n".join([found["stderr"], report.get("error") or "", report.get("ended") or ""])
    for word in words:
        assert word in text
    assert not found["left"]


@pytest.mark.parametrize("fault", ISOLATED)
def test_isolated(seen, fault):
    check(seen[f"{fault}:isolated"], ISOLATED[fault])


@pytest.mark.parametrize("fault", INSIDE)
def test_inside(seen, fault):
    check(seen[f"{fault}:inside"], INSIDE[fault])


@pytest.mark.parametrize("fault", UNLIMITED)
def test_ctrl_c_ends_an_isolated_fmu_that_hangs(seen, fault):
    check(seen[f"{fault}:unlimited"], UNLIMITED[fault])


@pytest.mark.parametrize("where", ["isolated", "inside"])
def test_steps_in_parts_end_where_whole_ones_do(seen, where):
    whole, parts = (seen[f"{fault}:{where}"]["report"]["last"][0] for fault in ("good", "partial"))
    assert (whole[4:], parts[4:]) == ([10, 10], [20, 20])  # both FMUs make half of the steps in three parts
    np.testing.assert_allclose(parts[:2], whole[:2], rtol=1e-12)  # the time and its square
    # The input is held for a shorter time.
    assert parts[2] - whole[2] == pytest.approx(0.008, rel=1e-9)


def test_both_give_the_same_rows(seen):
    for fault in ISOLATED.keys() & INSIDE.keys():
        reports = [seen[f"{fault}:{where}"]["report"] for where in ("isolated", "inside")]
        if all(reports) and reports[0]["rows"] == reports[1]["rows"]:
            assert reports[0]["last"] == reports[1]["last"], fault


def test_the_document_has_all_cases():
    text = DOCUMENT.read_text()
    assert not [fault for fault in {**ISOLATED, **INSIDE} if f"`{fault}`" not in text]
