"""How docstrings of the house become what Sphinx reads, and how names in them are resolved."""

import doctest
import importlib
import sys
import tomllib
from pathlib import Path

import pytest

SITE = Path(__file__).parents[2] / "docs" / "site"


@pytest.fixture(scope="module")
def load():
    """Imports an extension of the site by name."""
    pytest.importorskip("sphinx")
    sys.path.insert(0, str(SITE))
    yield importlib.import_module
    sys.path.remove(str(SITE))


def test_lists_of_parameters_become_definitions(load):
    lines = [
        "Do it.",
        "",
        "Parameters",
        "----------",
        "a, b: m, of both,",
        "    and more.",
        "*rest: others",
        "",
        "Then this.",
    ]
    assert load("house_docstrings").convert(lines) == [
        "Do it.", "", ".. rubric:: Parameters", "",
        "``a``, ``b``", "    m, of both,", "    and more.", "``*rest``", "    others", "", "", "Then this.",
    ]  # fmt: skip


def test_bars_are_bars_but_stay_in_code(load):
    lines = ["The size |x| of ``|y|``::", "", "    |z|", "", "and |w|."]
    assert load("house_docstrings").escape_bars(lines) == [
        "The size \\|x\\| of ``|y|``::", "", "    |z|", "", "and \\|w\\|."
    ]  # fmt: skip


def test_comments_of_fields_are_their_text(load):
    from ps_fmu.mechanism.dynamics import Pose

    assert load("house_docstrings").describe_fields(Pose)[3:-1] == [
        "``translation_B``", "    (3,), origin of P in B, m",
        "``rotation_BP``", "    (3, 3), maps components in P to components in B",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("target", "full"),
    [
        ("Master.run", "ps_fmu.cosim.Master.run"),
        (".scheme.Scheme", "ps_fmu.cosim.Scheme"),
        ("ps_fmu.pointing.indices.RelativeError", "ps_fmu.pointing.RelativeError"),
        ("..theory.loop", None),
        ("ValueError", None),
    ],
)
def test_names_lead_to_the_objects_of_the_api(load, target, full):
    assert load("python_names").find_object(target) == full


def test_folders_with_other_files_are_not_emptied(load, tmp_path, built_fmus):
    (tmp_path / "mine.txt").touch()
    with pytest.raises(FileExistsError, match="name another folder"):
        load("build").build(tmp_path, built_fmus)
    assert (tmp_path / "mine.txt").exists()


@pytest.mark.parametrize("page", [group["page"] for group in tomllib.loads((SITE / "api.toml").read_text())["group"]])
def test_examples_of_the_api_run(page, load, tmp_path, monkeypatch, built_fmus):
    """Those of each page, in a folder of their own; what they print is what the page shows."""
    [group] = [group for group in load("api_pages").GROUPS if group["page"] == page]
    monkeypatch.chdir(tmp_path)
    example = doctest.DocTestParser().get_doctest(group["example"], {}, page, None, 0)
    found = doctest.DocTestRunner().run(example)
    assert found.failed == 0 and found.attempted >= 3
    assert all((SITE.parents[1] / f"{guide}.md").exists() for guide in group["guides"])


def test_a_user_may_rely_on_forty_objects_at_most(load):
    assert 30 <= len(load("api_pages").list_objects()) <= 40


def test_types_are_those_of_the_source(load):
    from ps_fmu.pointing import RelativeError

    found = load("house_docstrings")._process_signature(
        None, "method", "", RelativeError.of_record, None, "(record: ndarray[...])", "Estimate"
    )
    assert found == ("(record: ArrayLike, step: float, *, stride: int | None = None)", "Estimate")


def test_the_page_of_commands_has_each_command_and_option(load):
    text = load("command_pages").make_page()
    for found in (
        "## ps-fmu run",
        "### ps-fmu analyse budget",
        "## ps-fmu sweep",
        "`--observe PATTERN`",
        "`--rate COMPONENT=N`",
    ):
        assert found in text
    assert "%(" not in text
