"""Settings for all tests: one thread in the linear algebra, repeatable property tests."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

# Before numpy is imported: the matrices are small, and several tests may share few cores.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
os.environ.setdefault("MPLBACKEND", "Agg")

settings.register_profile("repeatable", derandomize=True, max_examples=25, deadline=None, database=None)
settings.load_profile("repeatable")

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def built_fmus() -> Path:
    """Folder with the four FMUs of this checkout, built if they are missing or older than their sources."""
    from ps_fmu.scenarios.sources import ensure_built

    folder = ROOT / "build" / "fmus"
    ensure_built(folder, ROOT)
    return folder
