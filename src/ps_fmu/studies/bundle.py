"""What a worker needs of a study, as files: the system with its FMUs, what to run and to observe, the requirements.

The same files are sent to the workers and kept in the output folder, so that a case can be run again later.
"""

from __future__ import annotations

import hashlib
import io
import json
import tempfile
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

from ..cosim import Value, write_ssp
from ..cosim.rows import make_layout
from ..cosim.structure import Experiment
from ..runs.options import OptionError, RunOptions, Scenario
from ..runs.setup import RunSystem, load_system
from ..slavekit.pack import zip_writer
from .indices import check_windows, find_signals
from .plan import result_versions
from .study import Observed, Study, StudyError

SYSTEM, TASK, REQUIREMENTS = "system.ssp", "task.json", "requirements.toml"
DEFAULT_SIGNAL = "plant.payload_rotation"
DEFAULT_WINDOW_S = 1.0


@dataclass(frozen=True)
class Task:
    """What is done with each case."""

    step_s: float
    duration_s: float
    scheme: str
    runs: Mapping[str, Mapping[str, Value]]
    """Start values of each run, by its name."""
    observed: tuple[Observed, ...]
    versions: Mapping[str, str]
    """Of the packages that a row depends on, where the study was planned."""

    def as_json(self) -> bytes:
        """The content of the file; :meth:`from_json` reads it."""
        found = {**vars(self), "observed": [observed.as_dict() for observed in self.observed]}
        return json.dumps(found).encode()

    @classmethod
    def from_json(cls, text: bytes) -> Task:
        """What :meth:`as_json` has written."""
        found: dict[str, Any] = json.loads(text)
        return cls(**{**found, "observed": tuple(map(Observed.from_dict, found["observed"]))})


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
        for name, content in self.files.items():
            (place / name).write_bytes(content)
        return place

    def get_system_sha256(self) -> str:
        """SHA-256 of the content of the archive with wiring, start values and FMUs; not of its compression."""
        with zipfile.ZipFile(io.BytesIO(self.files[SYSTEM])) as archive:
            found = {PurePosixPath(item.filename): archive.read(item) for item in archive.infolist()}
        return zip_writer.compute_digest(found).hex()


def make_options(study: Study, output: Path, run: Any = None) -> RunOptions:
    """The study as options of a run.  ``run``: runs them, for a case that is run again.

    Raises :class:`..runs.options.OptionError`.
    """
    scenario = Scenario(
        study.name, study.name, run, study.duration_s, study.step_s, cases=tuple(study.runs), system=study.system.name
    )
    return RunOptions(
        scenario,
        system=study.system,
        output=output,
        duration_s=study.duration_s,
        step_s=study.step_s,
        parameters=study.parameters,
        scheme=study.scheme,
        requirements=study.requirements,
        fmus=study.fmus,
        progress=False,
    )


def load_study_system(study: Study) -> RunSystem:
    """The system of a study; requirements, signals and windows are checked against it.

    Raises :class:`.study.StudyError`, and :class:`..cosim.CosimError` for a system that cannot be read.
    """
    try:
        system = load_system(make_options(study, Path()))
    except OptionError as error:
        raise StudyError(f"{study.path}, [study], {_as_key(str(error))}") from error
    columns = make_layout(system.descriptions).columns
    for observed in study.observed:
        find_signals(observed, columns)
        check_windows(observed, study.step_s, study.duration_s)
    return system


def complete_observed(study: Study, system: RunSystem) -> Study:
    """The study; where it observes nothing, with the indices of the payload's rotation over 1 s."""
    if study.observed:
        return study
    from ..pointing.indices import AbsoluteError, MeanError, PointingIndex, RelativeError, ResidualJitter

    indices: list[PointingIndex] = [AbsoluteError()]
    if study.duration_s >= DEFAULT_WINDOW_S:
        window = DEFAULT_WINDOW_S
        indices += [MeanError(window), RelativeError(window, "uniform"), ResidualJitter(window)]
    observed = Observed(f"{study.path}, [[observe]]", (DEFAULT_SIGNAL,), tuple(indices))
    find_signals(observed, make_layout(system.descriptions).columns)
    return replace(study, observed=(observed,))


def make_bundle(study: Study, system: RunSystem) -> Bundle:
    """The files of a study.  Raises as :func:`..cosim.write_ssp`."""
    experiment = Experiment(0.0, study.duration_s, study.step_s)
    with tempfile.TemporaryDirectory(prefix="study_") as folder:
        path = Path(folder, SYSTEM)
        write_ssp(replace(system.structure, experiment=experiment), path)
        archive = path.read_bytes()
    task = Task(study.step_s, study.duration_s, study.scheme, study.runs, study.observed, result_versions())
    files = {SYSTEM: archive, TASK: task.as_json()}
    if study.requirements is not None:
        files[REQUIREMENTS] = study.requirements.read_bytes()
    return Bundle.of(files)


def _digest(files: Mapping[str, bytes]) -> str:
    named = {PurePosixPath(name): hashlib.sha256(content).digest() for name, content in files.items()}
    return zip_writer.compute_digest(named).hex()


def _as_key(problem: str) -> str:
    """The text of an option's error with the key of the study instead of the option."""
    return problem.removeprefix("--")
