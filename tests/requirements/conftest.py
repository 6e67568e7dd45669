"""Requirements written into files, and records with known answers."""

import numpy as np
import pytest
from support.required import COLUMNS, ENTRIES, to_toml

from ps_fmu.requirements.requirement import read_requirements


@pytest.fixture
def write(tmp_path):
    """Writes a file of requirements: the entries above with changes, a table for each; returns its path."""

    def write(*changes, text=None):
        path = tmp_path / "required.toml"
        path.write_text(to_toml(*({**ENTRIES, **change} for change in changes)) if text is None else text, "utf-8")
        return path

    return write


@pytest.fixture
def require(write):
    """The requirement with the entries above and changes."""

    def require(**changes):
        (requirement,) = read_requirements(write(changes))
        return requirement

    return require


@pytest.fixture
def white():
    """Independent Gaussian samples (n, columns) of unit RMS, by seed."""

    def white(count, seed=1):
        return np.random.default_rng(seed).standard_normal((count, len(COLUMNS)))

    return white
