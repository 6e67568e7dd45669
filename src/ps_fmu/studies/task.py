"""What is done with each case of a study, as the processes that run them are told."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ..cosim import Value
from ..cosim.isolation.instance import Isolation
from ..cosim.schemes.scheme import Scheme
from ..results.summary import versions
from .study import Observed

RESULT_PACKAGES = ("python", "ps_fmu", "numpy", "scipy", "fmpy", "pythonfmu")
"""Packages whose release may change a result."""


@dataclass(frozen=True)
class Task:
    """What is done with each case."""

    step_s: float
    duration_s: float
    scheme: Scheme
    runs: Mapping[str, Mapping[str, Value]]
    """Start values of each run, by its name."""
    observed: tuple[Observed, ...]
    versions: Mapping[str, str]
    """Of the packages that a row depends on, where the study was planned."""
    stored: tuple[str, ...] = ()
    """Names of the outputs that are stored of chosen cases."""
    stored_step_s: float | None = None
    """Between stored rows; None: every step."""
    isolation: Isolation | None = None
    """Which FMUs get processes of their own."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """The file of the checkpoint that each run begins from, by the name of the run; empty: from the initialisation."""
    anew: tuple[str, ...] = ()
    """Components that begin without their state there."""

    def as_json(self) -> bytes:
        """The content of the file; :meth:`from_json` reads it."""
        own = self.isolation
        isolation = None if own is None else {**vars(own), "names": None if own.names is None else sorted(own.names)}
        observed = [observed.as_dict() for observed in self.observed]
        found = {**vars(self), "observed": observed, "isolation": isolation, "scheme": self.scheme.as_dict()}
        return json.dumps(found).encode()

    @classmethod
    def from_json(cls, text: bytes) -> Task:
        """What :meth:`as_json` has written."""
        found: dict[str, Any] = json.loads(text)
        own: dict[str, Any] | None = found["isolation"]
        names = None if own is None or own["names"] is None else frozenset(own["names"])
        return cls(**{**found, "scheme": Scheme.from_dict(found["scheme"]),
                      "observed": tuple(map(Observed.from_dict, found["observed"])),
                      "stored": tuple(found["stored"]), "anew": tuple(found["anew"]),
                      "isolation": None if own is None else Isolation(**{**own, "names": names})})  # fmt: skip


def result_versions() -> dict[str, str]:
    """Versions of Python and of the packages that a row depends on; of Python without its patch level."""
    found = {name: version for name, version in versions().items() if name in RESULT_PACKAGES}
    found["python"] = ".".join(found["python"].split(".")[:2])
    return found
