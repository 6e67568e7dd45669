"""What a worker needs of a study, as files: the system with its FMUs, what is done with each case, what is required."""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from ..cosim import Value
from ..cosim.isolation.instance import Isolation
from ..cosim.schemes.scheme import Scheme
from ..results.summary import versions
from ..slavekit.pack.files import compute_digest
from .study import Observed

RESULT_PACKAGES = ("python", "ps_fmu", "numpy", "scipy", "fmpy", "pythonfmu")
"""Packages whose release may change a result."""
SYSTEM, TASK, REQUIREMENTS, INPUTS = "system.json", "task.json", "requirements.toml", "inputs.csv"
FMUS = "fmus"
"""Folder of the FMUs, each in a folder of its own: two may have one name."""
FAULTS = "faults"
"""JSON or YAML, which the content tells."""


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


@dataclass(frozen=True)
class Bundle:
    """Files by name, and the SHA-256 of all."""

    files: Mapping[str, bytes]
    sha256: str

    @classmethod
    def of(cls, files: Mapping[str, bytes]) -> Bundle:
        """The bundle of these files."""
        return cls(files, _digest(files))

    def unpack(self, folder: Path) -> Path:
        """Write the files into a new folder in ``folder``, named by their content; its path.

        Raises ``ValueError`` if the content is not what its SHA-256 says, ``OSError`` if it cannot be written.
        """
        if _digest(self.files) != self.sha256:
            raise ValueError(f"the study's files arrived damaged: their SHA-256 is not {self.sha256}")
        place = Path(tempfile.mkdtemp(prefix=f"study_{self.sha256[:16]}_", dir=folder))
        try:
            for name, content in self.files.items():
                (place / name).parent.mkdir(parents=True, exist_ok=True)
                (place / name).write_bytes(content)
        except BaseException:  # a full disk: each try would leave less room
            shutil.rmtree(place, ignore_errors=True)
            raise
        return place

    def get_system_sha256(self) -> str:
        """SHA-256 of the system: wiring, start values and FMUs."""
        own = (SYSTEM, f"{FMUS}/")
        return _digest({name: content for name, content in self.files.items() if name.startswith(own)})


def _digest(files: Mapping[str, bytes]) -> str:
    named = {PurePosixPath(name): hashlib.sha256(content).digest() for name, content in files.items()}
    return compute_digest(named).hex()
