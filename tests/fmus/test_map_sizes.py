"""The documentation states how many multiplications the maps of a step take: dense, not zero, and in blocks."""

import re

import numpy as np
import pytest
from support.models import MODELS, ROOT, slave_class

from ps_fmu.slavekit.author.blocks import store_by_columns

ROW = re.compile(r"\| (\w+) \| (\d+) \| (\d+) \| (\d+) \| ([\d.]+) \| ([\d.]+) \|")


def count(model):
    """Multiplications of a dense map, numbers in the maps that are not zero, those in blocks; kB dense, and in blocks.

    At rest in the first pose, with the default step.  None: the model has no map.
    """
    slave = slave_class(MODELS[model])(instance_name="count")
    slave.setup_experiment(0.0)
    slave.enter_initialization_mode()
    slave.exit_initialization_mode()
    slave.do_step(0.0, slave.default_step)
    maps = [found.matrix for found in slave._core.maps]
    if not maps:
        return None
    dense = store_by_columns(slave.step_map(slave.default_step)).size
    used = sum(int(np.count_nonzero(matrix.by_columns)) for matrix in maps)
    blocks = sum(matrix.operations for matrix in maps)
    return [dense, used, blocks, dense * 8e-3, blocks * 8e-3]


def test_documented_counts():
    counted = {model: numbers for model in MODELS if (numbers := count(model)) is not None}
    rows = ROW.finditer((ROOT / "docs" / "slavekit.md").read_text())
    stated = {row[1]: [float(value) for value in row.groups()[1:]] for row in rows}
    assert counted.keys() == stated.keys()
    for model, numbers in counted.items():
        assert stated[model] == pytest.approx(numbers, rel=0.02, abs=0.05), model  # zeros depend on the BLAS library
    assert counted["ManipulatorPlant"][2] < 0.5 * counted["ManipulatorPlant"][0]
