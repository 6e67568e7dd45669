"""docs/results.md: its examples run, on the results of a short default run."""

import doctest
from pathlib import Path

import pytest

from ps_fmu.runs.run import execute

DOCUMENT = Path(__file__).parents[2] / "docs" / "results.md"


@pytest.mark.filterwarnings("error")
def test_the_examples_of_the_document_run(make_options, monkeypatch, tmp_path):
    options = make_options("isolation", 7.0, step_s=1e-3)
    execute(options)
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "isolation").symlink_to(options.output)
    monkeypatch.chdir(tmp_path)
    found = doctest.testfile(str(DOCUMENT), module_relative=False)
    assert found.attempted > 8
    assert found.failed == 0
