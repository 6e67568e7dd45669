"""How docstrings of the house become what Sphinx reads, and how names in them are resolved."""

import importlib
import sys
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
        "``translation_B``", "    (..., 3), origin of P in B, m",
        "``rotation_BP``", "    (..., 3, 3), maps components in P to components in B",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("target", "scope", "full"),
    [
        ("Master.run", "ps_fmu.cosim.master.Master", "ps_fmu.cosim.master.Master.run"),
        ("run", "ps_fmu.cosim.master.Master", "ps_fmu.cosim.master.Master.run"),
        (".rows", "ps_fmu.cosim.master.Master", "ps_fmu.cosim.rows"),
        ("..theory.loop", "ps_fmu.mechanism.mounted", "ps_fmu.theory.loop"),
        ("ValueError", "ps_fmu.cosim", "ValueError"),
        ("numpy.float64", "", "numpy.float64"),
        ("no_such_name", "ps_fmu.cosim.master", None),
        ("Master.no_such_method", "ps_fmu.cosim.master", None),
    ],
)
def test_names_are_those_of_python(load, target, scope, full):
    assert load("python_names").resolve(target, scope) == full


def test_folders_with_other_files_are_not_emptied(load, tmp_path, built_fmus):
    (tmp_path / "mine.txt").touch()
    with pytest.raises(FileExistsError, match="name another folder"):
        load("build").build(tmp_path, built_fmus)
    assert (tmp_path / "mine.txt").exists()


def test_what_a_package_offers_is_where_it_is_defined(load):
    import ps_fmu.cosim
    import ps_fmu.pointing

    found = load("api_pages").list_offered(ps_fmu.pointing)
    assert len(found) == len(ps_fmu.pointing.__all__)
    assert "ps_fmu.pointing.indices.RelativeError" in found
    types = {"ps_fmu.cosim.clock.Event", "ps_fmu.cosim.values.Value"}
    assert types <= {*load("api_pages").list_offered(ps_fmu.cosim)}  # elsewhere they have no text of their own
