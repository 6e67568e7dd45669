"""How many multiplications the map of a step takes, FMU by FMU: dense, not zero, and in the blocks made of it."""

from __future__ import annotations

import numpy as np
from c_host import HERE, slave_class

from ps_fmu.runs.built_fmus import list_models
from ps_fmu.slavekit.author.blocks import store_by_columns


def count(model: str) -> tuple[int, int, int] | None:
    """Multiplications of a dense map, numbers in the maps that are not zero, and multiplications of their blocks.

    At rest in the first pose, with the default step.  None: the model has no map.
    """
    slave = slave_class(model)(instance_name="count")
    slave.setup_experiment(0.0)
    slave.enter_initialization_mode()
    slave.exit_initialization_mode()
    slave.do_step(0.0, slave.default_step)
    maps = [found.matrix for found in slave._core.maps]
    if not maps:
        return None
    dense = store_by_columns(slave.step_map(slave.default_step)).size
    used = sum(int(np.count_nonzero(matrix.by_columns)) for matrix in maps)
    return dense, used, sum(matrix.operations for matrix in maps)


def report() -> str:
    """A table for the documentation (docs/slavekit.md)."""
    lines = ["| FMU | dense | not zero | in blocks | kB dense | kB in blocks |", "|---|---|---|---|---|---|"]
    for model in sorted(list_models(HERE.parent)):
        if found := count(model):
            sizes = (f"{8 * found[k] / 1000:.1f}" for k in (0, 2))
            lines.append(f"| {model} | {' | '.join(map(str, found))} | {' | '.join(sizes)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(report())
