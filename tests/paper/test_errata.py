"""The errata: the right forms agree with an independent route, the printed ones do not."""

import pytest
from support.claims import verify_claim

from ps_fmu.paper.errata import ENTRIES, errata_table

# What the printed forms are off by at least; relative, or in the unit of the entry.
PRINTED = {
    "(8), (11)": 1.0,
    "(14)": 0.1,
    "(16), first line": 100.0,
    "Algorithm 1": 1e-4,  # deg
    "(20), (23)": 1.0,
    "(22)": 1.0,
    "(29), (30)": 1e-2,
    "(39)": 0.1,
    "(41), (42)": 0.9,
    "(50), line 4": 0.99,
    "(51) to (54), (55)": 100.0,
    "(56), last line": 5e-3,
    "(57)": 1.0,
    "(60)": 5e-3,
    "(A6)": 1e-8,
    "(A11), coarse legs": 0.2,
    "(A17) to (A25)": 0.03,
    "Table 1, section 5": 4.0,  # deg
    "Table 2, (8.5, 0, 0) deg, axis 3": 0.08,  # points
}
RIGHT = dict.fromkeys(PRINTED, 1e-9) | {
    "Algorithm 1": 1e-12,  # deg
    "(41), (42)": 1e-5,  # of the search for the peak
    "(43), (44)": 1e-9,  # the printed form cannot be computed
}
NO_RIGHT_NUMBER = {"(A6)", "Table 1, section 5", "Table 2, (8.5, 0, 0) deg, axis 3"}


@pytest.fixture(scope="module")
def entries(all_errata):
    return {erratum.equation: erratum for erratum in all_errata}


def test_each_entry_is_complete_and_there_once(entries):
    assert len(entries) == len(ENTRIES) == 23
    assert all(e.printed and e.right and e.evidence for e in entries.values())


def test_right_forms_agree_with_another_route(entries):
    errors = {name: e.error_right for name, e in entries.items() if e.error_right is not None}
    assert errors.keys() == RIGHT.keys() - NO_RIGHT_NUMBER
    verify_claim(
        "paper.errata",
        claim="The right forms of the equations that are printed wrong",
        where="`ps-fmu analyse paper`, docs/paper: errata",
        reference="another route to the same quantity: finite differences, energy, momentum, other tools",
        error=[error / RIGHT[name] for name, error in errors.items()],
        bound=1.0,
        unit="of what is allowed, 1e-12 to 1e-5 by equation",
    )


def test_printed_forms_do_not(entries):
    errors = {name: e.error_printed for name, e in entries.items() if e.error_printed is not None}
    assert errors.keys() == PRINTED.keys()
    assert not {name: error for name, error in errors.items() if not error > PRINTED[name]}


def test_what_is_known_by_reading_alone_says_so(entries):
    by_reading = {name for name, e in entries.items() if e.evidence == "by reading"}
    assert by_reading == {"(5)", "(A4), (A8), (A10), (A13), (A14), (A16)"}
    assert by_reading == entries.keys() - PRINTED.keys() - RIGHT.keys() - {"Fig 10, section 4.2"}


def test_table(entries):
    table = errata_table(list(entries.values()))
    rows = {row[0]: row for row in table.rows}
    assert rows["Table 2, (8.5, 0, 0) deg, axis 3"][2:5] == ("97.31 %", "-", "0.087 points")
    assert rows["(5)"][3:] == ("-", "-", "by reading")
    assert float(rows["(22)"][4]) == pytest.approx(1.0, abs=0.1)
