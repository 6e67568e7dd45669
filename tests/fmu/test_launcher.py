"""The launcher in an FMU is the one in the package, and pythonfmu's library is as pythonfmu ships it."""

import zipfile
from pathlib import Path

import pythonfmu

from ps_fmu.fmu.launcher.compile import LAUNCHER


def test_an_fmu_carries_both(built):
    stock = Path(pythonfmu.__file__).parent / "resources/binaries/linux64/libpythonfmu-export.so"
    with zipfile.ZipFile(built["waves"]) as archive:
        assert archive.read("binaries/linux64/libpythonfmu-export.so") == stock.read_bytes()
        assert archive.read("binaries/linux64/Waves.so") == LAUNCHER.path("linux64").read_bytes()
