"""Files of faults, and runs with them."""

from __future__ import annotations

import json

from ps_fmu.cosim.faults.reading import read_faults
from support.cosim import simulate


def write(folder, *events, end=None, **defaults):
    """A file of faults; events as keyword dictionaries."""
    content = {"defaults": defaults, "events": events, **({} if end is None else {"end": end})}
    path = folder / "faults.json"
    path.write_text(json.dumps(content))
    return read_faults(path)


def run_oscillator(system, faults=None, scheme="jacobi", duration=0.5, **options):
    """The rows by name."""
    rows = simulate(system, 0.01, duration, scheme, faults=faults, **options)
    return dict(zip(rows.names, rows.values.T, strict=True))
