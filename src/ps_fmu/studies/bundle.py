"""What a worker needs of a study, as files: the system with its FMUs, what to run and to observe, what is required."""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from ..slavekit.pack import zip_writer

SYSTEM, TASK, REQUIREMENTS, INPUTS = "system.json", "task.json", "requirements.toml", "inputs.csv"
FMUS = "fmus"
"""Folder of the FMUs, each in a folder of its own: two may have one name."""
FAULTS = "faults"
"""JSON or YAML, which the content tells."""


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
    return zip_writer.compute_digest(named).hex()
