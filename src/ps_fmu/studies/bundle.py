"""A study as files: what a worker needs of it, and its output folder, which says what it is a study of.

A worker needs the system with its FMUs, what is done with each case, and what is required.
"""

from __future__ import annotations

import hashlib
import io
import json
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any

import msgspec

from ..cosim import SystemFileError, Value
from ..cosim.checkpoint.parts import hash_file
from ..cosim.checkpoint.warm_start import WarmStart
from ..cosim.documents import read_document
from ..cosim.isolation.instance import Isolation
from ..cosim.schemes.scheme import Scheme
from ..files.archive import compute_digest
from ..requirements.quantity import make_value
from ..results.summary import versions
from ..runs.system import RunSystem
from .plan import Plan
from .rows import VersionError, write_durably
from .study import Observed, StudyError

RESULT_PACKAGES = ("python", "ps_fmu", "numpy", "scipy", "fmpy", "pythonfmu")
"""Packages whose release may change a result."""
SYSTEM, TASK, REQUIREMENTS, INPUTS = "system.json", "task.json", "requirements.toml", "inputs.csv"
FMUS = "fmus"
"""Folder of the FMUs, each in a folder of its own: two may have one name."""
FAULTS = "faults"
"""JSON or YAML, which the content tells."""
MANIFEST, PLAN, STUDY_COPY = "manifest.json", "plan.parquet", "study.toml"  # in the output folder
Sources = Mapping[str, WarmStart]
"""The checkpoint that each run begins from, by the name of the run; empty for a study without any."""


class Task(msgspec.Struct, frozen=True, kw_only=True):
    """What is done with each case."""

    step_s: float
    duration_s: float
    scheme: Scheme
    runs: dict[str, dict[str, Value]]
    """Start values of each run, by its name."""
    observed: tuple[Observed, ...]
    versions: dict[str, str] = {}
    """Of the packages that a row depends on, where the study was planned."""
    stored: tuple[str, ...] = ()
    """Names of the outputs that are stored of chosen cases."""
    stored_step_s: float | None = None
    """Between stored rows; None: every step."""
    isolation: Isolation | None = None
    """Which FMUs get processes of their own."""
    sources: dict[str, str] = {}
    """The file of the checkpoint that each run begins from, by the name of the run; empty: from the initialisation."""
    anew: tuple[str, ...] = ()
    """Components that begin without their state there."""

    def as_json(self) -> bytes:
        """The content of the file; :meth:`from_json` reads it."""
        return msgspec.json.encode(self, enc_hook=float)  # float: of a Time

    @classmethod
    def from_json(cls, text: bytes) -> Task:
        """What :meth:`as_json` has written."""
        return msgspec.json.decode(text, type=cls, dec_hook=_make_value)


def _make_value(kind: type, given: Any) -> Any:
    return kind(given) if issubclass(kind, float) else make_value(kind, given)


@cache
def worker_versions() -> dict[str, str]:
    """:func:`result_versions`, that of ps_fmu with the content of its modules: two checkouts may have one version."""
    root = Path(__file__).parents[1]
    copied = root / "product"  # in an installation: sources of FMUs, which travel with the study
    names = [path for kind in ("*.py", "*.so") for path in root.rglob(kind) if copied not in path.parents]
    content = _digest({path.relative_to(root).as_posix(): path.read_bytes() for path in names})
    found = result_versions()
    return {**found, "ps_fmu": f"{found['ps_fmu']} (modules {content[:12]})"}


def result_versions() -> dict[str, str]:
    """Versions of Python and of the packages that a row depends on; of Python without its patch level."""
    return clean_versions(versions())


def clean_versions(found: Mapping[str, str | None]) -> dict[str, str]:
    """As of :func:`result_versions`, from the versions of more packages; None: not installed."""
    chosen = {name: found[name] or "not installed" for name in RESULT_PACKAGES}
    return {**chosen, "python": ".".join(chosen["python"].split(".")[:2])}


def check_versions(expected: Mapping[str, str], own: Mapping[str, str], worker: str = "this worker") -> None:
    """Raises :class:`.rows.VersionError` where packages of a worker, by name, are others than ``expected``."""
    others = [f"{name} {own[name]} instead of {version}" for name, version in expected.items() if own[name] != version]
    if others:
        raise VersionError(
            f"{worker} has {', '.join(others)}: its rows would differ from those of this study. Install the releases "
            "of this command there, or end that worker"
        )


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


class Identity(msgspec.Struct, frozen=True, kw_only=True):
    """What decides the rows of a study, in the manifest."""

    plan_sha256: str
    """Of all of it."""
    study: str
    cases: int
    seed: int
    fmus: dict[str, str]
    """SHA-256 by name."""
    system_sha256: str
    """Of wiring, start values and FMUs."""
    requirements_sha256: str | None
    versions: dict[str, str]
    faults_sha256: str | None = None
    checkpoints_sha256: dict[str, str] | None = None
    """Of the checkpoint that each run begins from, by the name of the run."""
    inputs_sha256: str | None = None
    """Of the inputs over time."""

    @classmethod
    def of(cls, plan: Plan, system: RunSystem, bundle: Bundle, sources: Sources) -> Identity:
        """The identity of a plan for a system.  Raises ``OSError``."""
        files = {f"{name}_sha256": bundle.files.get(file) for name, file in (
            ("requirements", REQUIREMENTS), ("faults", FAULTS), ("inputs", INPUTS)
        )}  # fmt: skip
        known: dict[str, Any] = {
            "fmus": _name_fmus(system),
            "system_sha256": bundle.get_system_sha256(),
            "checkpoints_sha256": {run: hash_file(source.path) for run, source in sources.items()} or None,
            "versions": result_versions(),
            **{key: None if text is None else hashlib.sha256(text).hexdigest() for key, text in files.items()},
        }
        study = plan.study
        return cls(plan_sha256=_hash_plan(plan, known), study=study.name, cases=len(plan), seed=study.seed, **known)


def _hash_plan(plan: Plan, known: Mapping[str, Any]) -> str:
    """SHA-256, hexadecimal, of all that decides the rows of the study; ``known``: more of its :class:`Identity`."""
    study = plan.study
    stated: dict[str, Any] = {
        "factors": [(factor.name, factor.unit, factor.targets, factor.ratios) for factor in plan.factors],
        "draws": hashlib.sha256(plan.draws.astype("<f8").tobytes()).hexdigest(),
        "levels": [factor.levels for factor in plan.factors],
        "seed": (study.seed, study.seeds, plan.seed_names),
        "runs": study.runs,
        "times": (study.duration_s, study.step_s, study.scheme.as_dict()),
        "observed": [_describe(observed) for observed in study.observed],
        "requirements": known["requirements_sha256"] or hashlib.sha256(b"").hexdigest(),
        "system": known["system_sha256"],
        "fmus": known["fmus"],
        "versions": known["versions"],
        **{key: known[f"{key}_sha256"] for key in ("faults", "inputs") if known[f"{key}_sha256"] is not None},
    }
    if study.branch is not None:
        stated["from"] = (known["checkpoints_sha256"], sorted(study.branch.anew))
    return hashlib.sha256(json.dumps(stated, sort_keys=True).encode()).hexdigest()


def _describe(observed: Observed) -> dict[str, Any]:
    indices = [
        {"symbol": index.symbol, **{item.name: getattr(index, item.name) for item in fields(index)}}  # type: ignore[arg-type]
        for index in observed.indices
    ]
    return {"place": "", "signals": observed.signal, "indices": indices, "settling_s": observed.settling}


def _name_fmus(system: RunSystem) -> dict[str, str]:
    """SHA-256 of the FMUs by their names; of several with one name, by that of the component, too."""
    found: dict[str, str] = {}
    for component, fmu in zip(system.structure.components, system.fmus, strict=True):
        clash = found.get(fmu.name, fmu.sha256) != fmu.sha256
        found[f"{fmu.name} ({component.name})" if clash else fmu.name] = fmu.sha256
    return found


def open_folder(folder: Path, plan: Plan, identity: Identity, *, resume: bool) -> None:
    """Make the output folder that of a plan: manifest, plan, a copy of the study.

    Raises :class:`.study.StudyError` if it has another study, or this one and ``resume`` is not wanted; ``OSError``.
    """
    stored = read_identity(folder)
    if stored is None:
        write_durably(folder / STUDY_COPY, plan.study.path.read_bytes())
        write_durably(folder / PLAN, encode_plan(plan))
        text = json.dumps(msgspec.structs.asdict(identity), indent=2) + "\n"
        write_durably(folder / MANIFEST, text.encode())
        return
    if difference := explain_difference(stored, identity):
        raise StudyError(
            f"--output: {folder} has another study ({stored.study!r}): {difference}.  Nothing was changed; "
            "name another folder, or restore what the study was begun with"
        )
    if not resume:
        raise StudyError(f"--output: {folder} has this study already: --resume computes what is missing")


def read_identity(folder: Path) -> Identity | None:
    """The identity in the manifest of an output folder; None without one.  Raises :class:`.study.StudyError`."""
    if not (folder / MANIFEST).exists():
        return None
    try:
        return read_document(folder / MANIFEST, Identity)
    except SystemFileError as error:
        raise StudyError(f"{error}; the manifest of the study is damaged: name another --output") from error


def explain_difference(stored: Identity, own: Identity) -> str:
    """In what a study differs from that of a manifest, in words; nothing if it does not."""
    if stored.plan_sha256 == own.plan_sha256:
        return ""
    changed = [name for name, sha256 in own.fmus.items() if stored.fmus.get(name) != sha256]
    named = (f"{name} {own.fmus[name][:12]}, there {stored.fmus.get(name, 'none')[:12]}" for name in changed)
    found = [f"other FMUs: {', '.join(named)}"] if changed else []
    found += [
        f"{name} {version}, there {stored.versions.get(name)}"
        for name, version in own.versions.items()
        if stored.versions.get(name) != version
    ]
    if stored.cases != own.cases:
        found.append(f"{own.cases} cases, there {stored.cases}")
    if stored.seed != own.seed:
        found.append(f"seed {own.seed}, there {stored.seed}")
    for key, text in (("requirements", "other requirements"), ("faults", "other faults"),
                      ("inputs", "other inputs over time")):  # fmt: skip
        if getattr(stored, f"{key}_sha256") != getattr(own, f"{key}_sha256"):
            found.append(text)
    found += _compare_checkpoints(stored.checkpoints_sha256 or {}, own.checkpoints_sha256 or {})
    if not changed and stored.system_sha256 != own.system_sha256:
        found.append("another wiring, or other start values")
    return "; ".join(found) or "other parameters, times or signals in the study's file"


def _compare_checkpoints(stored: Mapping[str, str], own: Mapping[str, str]) -> list[str]:
    if stored and own:
        return [
            f"another checkpoint for the run {run}: {sha256[:12]}, there {stored.get(run, 'none')[:12]}"
            for run, sha256 in own.items()
            if stored.get(run) != sha256
        ]
    return [] if stored == own else [f"{'a' if own else 'no'} checkpoint to begin from"]


def encode_plan(plan: Plan) -> bytes:
    """The plan as a Parquet file: ``case``, the draw of each factor, and what is set, by ``component.parameter``."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    content = io.BytesIO()
    schema = [pa.field("case", pa.int64())]
    columns: list[Any] = [pa.array(range(len(plan)))]
    for factor, draws in zip(plan.factors, plan.draws.T, strict=True):
        if factor.name not in plan.targets:
            schema.append(pa.field(factor.name, pa.float64(), metadata={"unit": factor.unit}))
            columns.append(pa.array(draws))
        for name in factor.targets:
            column = pa.array([factor.values(draw)[name] for draw in draws.tolist()])
            schema.append(pa.field(name, column.type, metadata={"unit": factor.unit}))
            columns.append(column)
    for name in plan.seed_names:
        schema.append(pa.field(name, pa.int64()))
        columns.append(pa.array([plan.seeds(index)[name] for index in range(len(plan))], pa.int64()))
    pq.write_table(pa.table(columns, schema=pa.schema(schema)), content)
    return content.getvalue()
