"""``ps-fmu run`` of an FMU that has no outputs."""

import netCDF4
import numpy as np
from pythonfmu.builder import FmuBuilder

from ps_fmu.cli import main


def test_an_fmu_without_outputs_leaves_its_times(tmp_path):
    script = tmp_path / "quiet.py"
    script.write_text(
        "from pythonfmu import Fmi2Causality, Fmi2Slave, Real\n"
        "class Quiet(Fmi2Slave):\n"
        "    def __init__(self, **given):\n"
        "        super().__init__(**given)\n"
        "        self.u = 0.0\n"
        "        self.register_variable(Real('u', causality=Fmi2Causality.input))\n"
        "    def do_step(self, t, h):\n"
        "        return True\n"
    )
    fmu, out = FmuBuilder.build_FMU(script, dest=tmp_path), tmp_path / "out"
    assert main(["run", str(fmu), "--step", "0.125", "--duration", "1", "--no-figures", "--output", str(out)]) == 0
    with netCDF4.Dataset(out / "results.nc") as file:
        assert list(file["run"].variables) == ["time"]
        np.testing.assert_array_equal(file["run/time"][:], np.arange(9) * 0.125)
