"""The launchers in an FMU are those in the package, and pythonfmu's libraries are as pythonfmu ships them."""

import zipfile
from pathlib import Path

import pytest
import pythonfmu

from ps_fmu.native import list_platforms, read_compiled

STOCK = Path(pythonfmu.__file__).parent / "resources" / "binaries"


@pytest.mark.parametrize(
    ("platform", "launcher", "library"),
    [("linux64", "Waves.so", "libpythonfmu-export.so"), ("win64", "Waves.dll", "pythonfmu-export.dll")],
)
def test_an_fmu_carries_both(built, platform, launcher, library):
    with zipfile.ZipFile(built["waves"]) as archive:
        assert archive.read(f"binaries/{platform}/{library}") == (STOCK / platform / library).read_bytes()
        assert archive.read(f"binaries/{platform}/{launcher}") == read_compiled("launcher", platform)[1]


def test_a_launcher_is_of_no_use_where_pythonfmu_has_no_library(built):
    with zipfile.ZipFile(built["waves"]) as archive:
        platforms = {name.split("/")[1] for name in archive.namelist() if name.startswith("binaries/")}
    assert platforms == {path.name for path in STOCK.iterdir()} < set(list_platforms("launcher"))
