"""No step of an FMU of ps_fmu enters Python, from the first one on."""

from pathlib import Path

import pytest
from support.host import unpack
from support.models import MODELS
from support.twins import InFmpy

STEPS = (1e-4, 1e-4, 3e-4, 1e-3, 2.5e-5)  # s


@pytest.mark.parametrize("model", MODELS)
def test_steps_of_changing_size_with_changing_inputs(model, built_fmus, tmp_path: Path):
    """All Real inputs move and all Boolean inputs switch; a state that comes as bytes goes on."""
    instance = InFmpy(unpack(built_fmus / f"{model}.fmu", tmp_path))
    instance.initialise()
    t, taken = 0.0, 0
    for k in range(100):
        reals = {v.name: 1e-6 * k + float(v.start or 0.0) for v in instance.inputs if v.type == "Real"}
        booleans = {v.name: k % 20 > 3 for v in instance.inputs if v.type == "Boolean"}
        instance.set(reals | booleans)
        instance.step(t, STEPS[k % len(STEPS)])
        t += STEPS[k % len(STEPS)]
        taken += 1
        if k == 50:
            instance.restore(instance.state())
    assert instance.steps() == (taken, 0)
    instance.end()
