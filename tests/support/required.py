"""A file of requirements and the columns that it speaks of."""

import json

from ps_fmu.cosim import Column

COLUMNS = (
    Column("plant.rotation.x", "rad", "Real", ""),
    Column("plant.rotation.y", "rad", "Real", ""),
    Column("plant.los.x", "m", "Real", ""),
    Column("plant.leg_1", "m", "Real", ""),
    Column("plant.leg_2", "m", "Real", ""),
    Column("commander.reachable", "1", "Boolean", ""),
)
ENTRIES = {
    "name": "blur", "signal": "plant.rotation.x", "index": "RPE", "at": "uniform", "window": "1 s",
    "probability": 0.95, "confidence": 0.9, "interpretation": "temporal", "limit": "0.5 urad",
}  # fmt: skip


def to_toml(*tables):
    """Tables of a file; an entry of None is left out."""
    lines: list[str] = []
    for table in tables:
        lines.append("[[requirement]]")
        lines += [f"{key} = {json.dumps(value)}" for key, value in table.items()
                  if value is not None]  # fmt: skip
    return "\n".join(lines) + "\n"
