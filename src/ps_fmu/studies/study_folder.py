"""The output folder of a study: what it is a study of, its plan, and whether it can be resumed."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..cosim.checkpoint.parts import hash_file
from ..runs.setup import RunSystem, identify_fmus
from .bundle import FAULTS, INPUTS, REQUIREMENTS, Bundle, result_versions
from .plan import Plan, hash_plan
from .preparation import Sources
from .rows import write_durably
from .study import StudyError

MANIFEST, PLAN, STUDY_COPY = "manifest.json", "plan.parquet", "study.toml"
TABLES = ("fmus", "versions", "checkpoints_sha256")
"""Keys of a manifest with texts by name."""


@dataclass(frozen=True)
class Identity:
    """What decides the rows of a study, in the manifest."""

    plan_sha256: str
    """Of all of it."""
    study: str
    cases: int
    seed: int
    fmus: Mapping[str, str]
    """SHA-256 by name."""
    system_sha256: str
    """Of wiring, start values and FMUs."""
    requirements_sha256: str | None
    versions: Mapping[str, str]
    faults_sha256: str | None = None
    checkpoints_sha256: Mapping[str, str] | None = None
    """Of the checkpoint that each run begins from, by the name of the run."""
    inputs_sha256: str | None = None
    """Of the inputs over time."""

    @classmethod
    def of(cls, plan: Plan, system: RunSystem, bundle: Bundle, sources: Sources) -> Identity:
        """The identity of a plan for a system.  Raises ``OSError``."""
        fmus = _name_fmus(system)
        requirements, faults, inputs = (bundle.files.get(name) for name in (REQUIREMENTS, FAULTS, INPUTS))
        archive = bundle.get_system_sha256()
        checkpoints = {run: hash_file(source.path) for run, source in sources.items()} or None
        return cls(
            hash_plan(plan, fmus, archive, requirements or b"", faults or b"", checkpoints, inputs or b""),
            plan.study.name,
            len(plan),
            plan.study.seed,
            fmus,
            archive,
            _hash(requirements),
            result_versions(),
            _hash(faults),
            checkpoints,
            _hash(inputs),
        )


def _hash(content: bytes | None) -> str | None:
    return None if content is None else hashlib.sha256(content).hexdigest()


def _name_fmus(system: RunSystem) -> dict[str, str]:
    """SHA-256 of the FMUs by their names; of several with one name, by that of the component, too."""
    found: dict[str, str] = {}
    for component, fmu in zip(system.structure.components, identify_fmus(system), strict=True):
        clash = found.get(fmu.name, fmu.sha256) != fmu.sha256
        found[f"{fmu.name} ({component.name})" if clash else fmu.name] = fmu.sha256
    return found


def open_folder(folder: Path, plan: Plan, identity: Identity, *, resume: bool) -> None:
    """Make the output folder that of a plan: manifest, plan, a copy of the study.

    Raises :class:`.study.StudyError` if it has another study, or this one and ``resume`` is not wanted; ``OSError``.
    """
    manifest = folder / MANIFEST
    if manifest.exists():
        _compare(folder, _read(manifest), identity, resume)
        return
    write_durably(folder / STUDY_COPY, plan.study.path.read_bytes())
    write_durably(folder / PLAN, encode_plan(plan))
    write_durably(manifest, (json.dumps(asdict(identity), indent=2) + "\n").encode())


def read_identity(folder: Path) -> Identity | None:
    """The identity in the manifest of an output folder; None without one.  Raises :class:`.study.StudyError`."""
    manifest = folder / MANIFEST
    if not manifest.exists():
        return None
    try:
        return Identity(**_read(manifest))
    except TypeError as error:
        raise StudyError(f"{manifest}: is no manifest of a study: {error}") from error


def explain_difference(stored: Mapping[str, Any], own: Identity) -> str:
    """In what a study differs from that of a manifest, in words; nothing if it does not."""
    if stored.get("plan_sha256") == own.plan_sha256:
        return ""
    found = []
    fmus = stored.get("fmus") or {}
    changed = [name for name, sha256 in own.fmus.items() if fmus.get(name) != sha256]
    if changed:
        named = (f"{name} {own.fmus[name][:12]}, there {fmus.get(name, 'none')[:12]}" for name in changed)
        found.append(f"other FMUs: {', '.join(named)}")
    versions = stored.get("versions") or {}
    found += [
        f"{name} {version}, there {versions.get(name)}"
        for name, version in own.versions.items()
        if versions.get(name) != version
    ]
    if stored.get("cases") != own.cases:
        found.append(f"{own.cases} cases, there {stored.get('cases')}")
    if stored.get("seed") != own.seed:
        found.append(f"seed {own.seed}, there {stored.get('seed')}")
    if stored.get("requirements_sha256") != own.requirements_sha256:
        found.append("other requirements")
    if stored.get("faults_sha256") != own.faults_sha256:
        found.append("other faults")
    if stored.get("inputs_sha256") != own.inputs_sha256:
        found.append("other inputs over time")
    found += _compare_checkpoints(stored.get("checkpoints_sha256") or {}, own.checkpoints_sha256 or {})
    if not changed and stored.get("system_sha256") != own.system_sha256:
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
    fields = [pa.field("case", pa.int64())]
    columns: list[Any] = [pa.array(range(len(plan)))]
    for factor, draws in zip(plan.factors, plan.draws.T, strict=True):
        if factor.name not in plan.targets:
            fields.append(pa.field(factor.name, pa.float64(), metadata={"unit": factor.unit}))
            columns.append(pa.array(draws))
        for name in factor.targets:
            column = pa.array([factor.values(draw)[name] for draw in draws.tolist()])
            fields.append(pa.field(name, column.type, metadata={"unit": factor.unit}))
            columns.append(column)
    for name in plan.seed_names:
        fields.append(pa.field(name, pa.int64()))
        columns.append(pa.array([plan.seeds(index)[name] for index in range(len(plan))], pa.int64()))
    pq.write_table(pa.table(columns, schema=pa.schema(fields)), content)
    return content.getvalue()


def _read(manifest: Path) -> dict[str, Any]:
    try:
        found = json.loads(manifest.read_bytes())
    except (ValueError, RecursionError) as error:
        raise StudyError(f"{manifest}: cannot be read: {error}") from error
    if not isinstance(found, dict):
        raise StudyError(f"{manifest}: is no manifest of a study: expected a table of keys")
    for key in TABLES:
        table = found.get(key)
        named = isinstance(table, dict) and all(isinstance(value, str) for value in table.values())
        if not (named or (table is None and key == "checkpoints_sha256")):
            raise StudyError(f"{manifest}, {key}: is damaged: expected texts by name; name another --output")
    return found


def _compare(folder: Path, stored: Mapping[str, Any], identity: Identity, resume: bool) -> None:
    if difference := explain_difference(stored, identity):
        raise StudyError(
            f"--output: {folder} has another study ({stored.get('study')!r}): {difference}.  Nothing was changed; "
            "name another folder, or restore what the study was begun with"
        )
    if not resume:
        raise StudyError(f"--output: {folder} has this study already: --resume computes what is missing")
