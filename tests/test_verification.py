"""docs/verification.md says what the tests claim, and nothing else; a test that claims has to find."""

from pathlib import Path

import pytest
from support.claims import RECORDS, expect_claims, find_claims, read_claims
from support.claims import verify_claim as verify
from support.models import load_script

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "verification.md"
TEST = """
def test_budget():
    verify_claim(
        "budget.shares",
        claim="The shares of {what}",
        where="terminal of `ps-fmu analyse budget`",
        reference="runs with one source at a time",
        error=found,
        bound=0.05,
    )
"""


@pytest.fixture(scope="module")
def script():
    return load_script(ROOT / "docs" / "write_verification.py")


@pytest.fixture
def claims(tmp_path):
    """Writes a file of tests, returns its claims."""

    def write(text, name="test_own.py"):
        (tmp_path / name).write_text(text)
        read_claims.cache_clear()
        return find_claims(tmp_path)

    return write


def test_the_page_is_what_the_tests_claim(script):
    """Same claims, references, bounds and tests; each error found is within its bound."""
    claims, text = find_claims(), PAGE.read_text(encoding="utf-8")
    errors = script.read_errors(text, claims.values())
    assert script.render(claims, errors) == text, "make verify writes it again"
    assert [name for name, error in errors.items() if float(error.removeprefix("below ")) > claims[name].bound] == []


def test_a_page_with_other_words_or_tests_is_found(script, claims):
    ours = claims(TEST)
    page = script.render(ours, {"budget.shares": "0.02"})
    assert "| The shares of {what}. *terminal of `ps-fmu analyse budget`.* | runs with one" in page
    assert "| 0.05 relative | 0.02 | `test_budget` |" in page
    assert script.read_errors(page, ours.values()) == {"budget.shares": "0.02"}
    for old, new in (("{what}", "modes"), ("0.05", "0.5"), ("test_budget", "test_other"), ("at a time", "alone")):
        others = claims(TEST.replace(old, new))
        assert script.read_errors(page, others.values()) == {}
        with pytest.raises(ValueError, match=r"no error found is known .*\n  budget\.shares: test_(budget|other)"):
            script.render(others, {})
    assert script.render({}, {}) != page  # the test is gone, its row is still there
    with pytest.raises(ValueError, match=r"no section for nothing\.shares: run, slew"):
        script.render(claims(TEST.replace("budget.shares", "nothing.shares")), {"nothing.shares": "0"})


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('"The shares of {what}"', "WHAT", r"test_own\.py, line 3: all arguments .* are literals"),
        ("        bound=0.05,\n", "", "all arguments .* missing .* 'bound'"),
        ("test_budget", "find_budget", "is called in the function of a test"),
        ("{what}", "a|b", "have no '|'"),
    ],
)
def test_claims_that_cannot_be_read_are_named(claims, old, new, text):
    with pytest.raises(ValueError, match=text):
        claims(TEST.replace(old, new))


def test_two_claims_of_one_name_are_refused(claims):
    claims(TEST)
    with pytest.raises(ValueError, match=r"two claims are named budget\.shares"):
        claims(TEST, "test_second.py")


def test_a_test_that_passes_has_recorded_what_it_claims(claims, tmp_path, monkeypatch):
    claims(TEST)
    monkeypatch.setenv(RECORDS, str(tmp_path / "records"))
    with (
        pytest.raises(AssertionError, match=r"test_budget passed and did not record .*: budget\.shares"),
        expect_claims(tmp_path / "test_own.py", "test_budget"),
    ):
        pass
    given = {"claim": "c", "where": "w", "reference": "r", "bound": 0.1}
    with expect_claims(tmp_path / "test_own.py", "test_budget"):
        verify("budget.shares", error=[-1.0, 0.1], **given)
        for wrong in ([0.0, 0.11], float("nan")):
            with pytest.raises(AssertionError, match=r"budget\.shares: c\. Error .*, bound 0\.1 \(relative\) .*: r"):
                verify("budget.shares", error=wrong, **given)
    assert (tmp_path / "records").read_text() == '{"name": "budget.shares", "error": 0.1}\n'


@pytest.mark.parametrize(
    ("error", "shown"),
    [(0.0, "0"), (1e-9, "below 5e-05"), (1.01e-3, "0.002"), (0.02, "0.02"), (0.0201, "0.03"), (0.05, "0.05")],
)
def test_errors_are_rounded_up(script, error, shown):
    assert script.round_up(error, 0.05) == shown


def test_each_kind_of_answer_has_claims(script):
    assert {name.split(".")[0] for name in find_claims()} == script.SECTIONS.keys()
