"""The table of analyses."""

import inspect

import pytest

from ps_fmu.analyses.table import ANALYSES
from ps_fmu.cli import main


@pytest.mark.parametrize("name", ANALYSES)
def test_each_analysis_is_a_function_of_options(name):
    assert next(iter(inspect.signature(ANALYSES[name].load()).parameters)) == "options"


def test_the_help_lists_all_in_the_order_of_the_table(capsys):
    assert main(["analyse", "--help"]) == 0
    listed = [line.split()[0] for line in capsys.readouterr().out.splitlines() if line.startswith("    ")]
    assert [name for name in listed if name in ANALYSES] == list(ANALYSES)
