import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from ps_fmu.results.summary import FmuFile, versions, write_summary


def test_numbers_are_as_json_knows_them(tmp_path):
    content = {
        "rms_rad": np.array([1.65e-5, 5.02e-6]), "rejection_percent": [99.4, float("nan")], "seed": 1,
        "factor": np.float64(3.5), "none": None, "fmus": (FmuFile("Plant", "0" * 64),),
        "cases": [{"rms": np.ones(2), "file": Path("a")}],
    }  # fmt: skip
    write_summary(tmp_path / "summary.json", content)
    read = json.loads((tmp_path / "summary.json").read_text(), parse_constant=pytest.fail)
    assert read == {
        "rms_rad": [1.65e-5, 5.02e-6], "rejection_percent": [99.4, None], "seed": 1, "factor": 3.5, "none": None,
        "fmus": [{"name": "Plant", "sha256": "0" * 64}], "cases": [{"rms": [1.0, 1.0], "file": "a"}],
    }  # fmt: skip
    assert isinstance(read["seed"], int)


def test_what_json_does_not_know_is_named(tmp_path):
    with pytest.raises(TypeError, match=r"summary\.json\.cases\[1\]: a object"):
        write_summary(tmp_path / "summary.json", {"cases": [1, object()]})
    assert list(tmp_path.iterdir()) == []


def test_fmu_files_are_hashed(tmp_path):
    path = tmp_path / "Plant.fmu"
    path.write_bytes(b"content")
    assert FmuFile.of(path) == FmuFile("Plant", hashlib.sha256(b"content").hexdigest())


def test_versions_name_what_results_depend_on():
    found = versions()
    assert {"python", "ps_fmu", "fmpy", "pythonfmu", "numpy"} <= set(found)
    assert "not installed" not in found.values()
