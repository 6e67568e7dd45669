import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from ps_fmu.results.summary import FmuFile, RunSummary, versions

RUN = {
    "scenario": "isolation",
    "orientation_deg": (0.0, 0.0, 0.0),
    "step_s": 1e-4,
    "duration_s": 20.0,
    "seed": 1,
    "rms_passive_rad": np.array([1.65e-5, 5.02e-6, 5.34e-6]),
    "rms_active_rad": np.array([1e-7, 4e-8, 1e-7]),
    "rejection_percent": [99.4, 99.2, float("nan")],
    "real_time_factor": np.float64(3.5),
    "fmus": (FmuFile("ManipulatorPlant", "0" * 64),),
}


def test_the_file_has_the_documented_keys(tmp_path):
    RunSummary(**RUN, more={"scheme": "jacobi", "cases": [{"rms": np.ones(2), "file": Path("a")}]}).write(
        tmp_path / "summary.json"
    )
    read = json.loads((tmp_path / "summary.json").read_text(), parse_constant=pytest.fail)
    assert list(read) == [*RUN, "versions", "scheme", "cases"]
    assert read["rms_passive_rad"] == [1.65e-5, 5.02e-6, 5.34e-6]
    assert read["rejection_percent"] == [99.4, 99.2, None]
    assert read["fmus"] == [{"name": "ManipulatorPlant", "sha256": "0" * 64}]
    assert read["cases"] == [{"rms": [1.0, 1.0], "file": "a"}]
    assert isinstance(read["seed"], int)
    assert isinstance(read["real_time_factor"], float)


def test_scenarios_without_rejection_say_null():
    without = RUN | {"rms_passive_rad": None, "rms_active_rad": None, "rejection_percent": None}
    assert RunSummary(**without).as_dict()["rms_passive_rad"] is None


def test_wrong_entries_are_named():
    with pytest.raises(ValueError, match="rms_active_rad: expected three"):
        RunSummary(**RUN | {"rms_active_rad": [1.0, 2.0]})
    with pytest.raises(ValueError, match="more: repeats seed"):
        RunSummary(**RUN, more={"seed": 2})
    with pytest.raises(TypeError, match=r"cases\[1\]: a object"):
        RunSummary(**RUN, more={"cases": [1, object()]}).as_dict()


def test_fmu_files_are_hashed(tmp_path):
    path = tmp_path / "Plant.fmu"
    path.write_bytes(b"content")
    assert FmuFile.of(path) == FmuFile("Plant", hashlib.sha256(b"content").hexdigest())


def test_versions_name_what_results_depend_on():
    found = versions()
    assert {"python", "ps_fmu", "fmpy", "pythonfmu", "numpy"} <= set(found)
    assert "not installed" not in found.values()
