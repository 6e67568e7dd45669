"""The options of a run with checkpoints, in a file beside them: ``--resume`` needs no other options."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from .. import __version__
from ..cosim.isolation.instance import Isolation
from ..cosim.schemes.scheme import Iteration, Scheme, read_rate
from ..cosim.ssp.osp import OSP_NAME
from ..cosim.ssp.sources import SSD_NAME
from ..slavekit.pack.files import write_atomically
from .options import CHECKPOINTS, OptionError

RUN = "run.json"
"""Name of the file in the folder of the checkpoints."""
FORMAT = 1
SCENARIO, SYSTEM = "scenario", "system"
"""What was run: a scenario, or any system."""


@dataclass(frozen=True)
class KeptRun:
    """A run that can go on."""

    kind: str
    """:data:`SCENARIO` or :data:`SYSTEM`."""
    name: str
    """Of the scenario."""
    options: Mapping[str, Any]
    """Those of :class:`.options.RunOptions` or :class:`.any_system.AnyRun` by name."""


def write_run(output: Path, kind: str, name: str, options: Mapping[str, Any]) -> None:
    """Note what runs in an output folder.  Raises OSError."""
    (output / CHECKPOINTS).mkdir(parents=True, exist_ok=True)
    kept = {key: _encode(value) for key, value in options.items() if key in _READERS}
    document = {
        "format": FORMAT, "package": __version__, "complete": False, "kind": kind, "name": name, "options": kept,
        "files": {str(path): _hash(path) for path in _list_files(options)},
    }  # fmt: skip
    _write(output, document)


def note_complete(output: Path) -> None:
    """Note that there is nothing to go on with.  Raises OSError."""
    _write(output, {**_read(output), "complete": True})


def can_go_on(output: Path) -> bool:
    """Whether there is a run in an output folder that is not complete."""
    try:
        return _read(output).get("complete") is False
    except OptionError:
        return False


def read_run(output: Path) -> KeptRun:
    """The run in an output folder.

    Raises :class:`OptionError`: there is none, it is complete, it is of another version of ps_fmu, a file that it uses
    has changed, or the file about it is damaged.
    """
    document = _read(output)
    if document.get("complete") is not False:
        raise OptionError(f"--resume: the run in {output} is complete: there is nothing to go on with")
    if (found := document.get("package")) != __version__:
        raise OptionError(f"--resume: the run in {output} is of ps_fmu {found}, this is {__version__}: run it anew")
    try:
        options = {name: _READERS[name](value) for name, value in document["options"].items()}
        files = {Path(path): text for path, text in document["files"].items()}
        kind, name = document["kind"], document["name"]
        if kind not in (SCENARIO, SYSTEM) or not isinstance(name, str):
            raise ValueError(f"a run of the kind {kind!r}")
    except (KeyError, ValueError, TypeError, AttributeError) as error:
        raise OptionError(f"--resume: {output / CHECKPOINTS / RUN} is damaged: {error!r}") from error
    for path, sha256 in files.items():
        if not path.is_file() or _hash(path) != sha256:
            raise OptionError(f"--resume: {path} is not as it was when the run began: run it anew")
    return KeptRun(kind, name, {**options, "output": output})


def check_options(output: Path, kind: str, name: str, options: Mapping[str, Any]) -> None:
    """Raises :class:`OptionError` as :func:`read_run`, and for options with which the run in the folder cannot go on.

    Whether figures are drawn is free.
    """
    kept = read_run(output)
    if (kept.kind, kept.name) != (kind, name):
        raise OptionError(f"--resume: the run in {output} is one of {kept.name!r}, this is one of {name!r}")
    for key, value in kept.options.items():
        if key not in ("figures", "output") and _encode(value) != _encode(options[key]):
            raise OptionError(
                f"--resume: the run in {output} was begun with another value of {name_option(key)}: "
                f"{_encode(value)!r} there, {_encode(options[key])!r} here: it goes on with the options that it has"
            )


def name_option(name: str) -> str:
    """An option as on the command line, by its name in Python."""
    special = {"source": "--from", "isolation": "--isolate", "inputs": "--input"}
    return special.get(name, "--" + name.removesuffix("_s").replace("_", "-"))


def _write(output: Path, document: Mapping[str, Any]) -> None:
    write_atomically(output / CHECKPOINTS / RUN, json.dumps(document, indent=1) + "\n")


def _read(output: Path) -> dict[str, Any]:
    path = output / CHECKPOINTS / RUN
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise OptionError(f"--resume: there is no run with checkpoints in {output}: no file {path}") from None
    except (OSError, ValueError, RecursionError) as error:
        raise OptionError(f"--resume: {path} cannot be read: {error}") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise OptionError(f"--resume: {path} is damaged, or of another version of ps_fmu")
    return document


def _list_files(options: Mapping[str, Any]) -> list[Path]:
    """Files whose content decides on the results, but for the FMUs, which are in each checkpoint."""
    single = [options.get(name) for name in ("system", "requirements", "disturbance", "inputs", "faults")]
    found = [path.absolute() for path in (*single, *options.get("parameters", ())) if path is not None]
    # A system in a folder is what its description says.
    return [next(filter(Path.is_file, (path / SSD_NAME, path / OSP_NAME)), path) if path.is_dir() else path
            for path in found]  # fmt: skip


def _hash(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _encode(value: Any) -> Any:
    if isinstance(value, Path):
        return str(value.absolute())
    if isinstance(value, Isolation):
        return {"names": None if value.names is None else sorted(value.names), "step_timeout_s": value.step_timeout_s,
                "call_timeout_s": value.call_timeout_s}  # fmt: skip
    if isinstance(value, Scheme):
        return {"order": value.order, "extrapolation": value.extrapolation, "error_estimate": value.error_estimate,
                "rates": {name: str(rate) for name, rate in value.rates.items()},
                "iteration": asdict(value.iteration)}  # fmt: skip
    return [_encode(one) for one in value] if isinstance(value, tuple) else value


def _read_number(value: Any) -> float:
    if type(value) not in (int, float) or not math.isfinite(value):
        raise ValueError(f"expected a number, found {value!r}")
    return float(value)


def _read_whole(value: Any) -> int:
    if type(value) is not int:
        raise ValueError(f"expected a whole number, found {value!r}")
    return value


def _read_text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError(f"expected a text, found {value!r}")
    return value


def _read_flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"expected true or false, found {value!r}")
    return value


def _read_path(value: Any) -> Path:
    return Path(_read_text(value))


def _read_texts(value: Any) -> tuple[str, ...]:
    return tuple(_read_text(one) for one in value)


def _read_isolation(value: Any) -> Isolation:
    names = value["names"]
    step, call = _read_number(value["step_timeout_s"]), _or_none(_read_number)(value["call_timeout_s"])
    return Isolation(None if names is None else frozenset(_read_texts(names)), step, call)


def _read_scheme(value: Any) -> str | Scheme:
    if isinstance(value, str):
        return value
    how = value["iteration"]
    iteration = Iteration(
        _read_text(how["method"]), _read_number(how["relative"]), _read_number(how["absolute"]),
        _read_whole(how["limit"]),
    )  # fmt: skip
    rates = {name: read_rate(_read_text(text)) for name, text in value["rates"].items()}
    return Scheme(
        _read_text(value["order"]), _read_text(value["extrapolation"]), rates, iteration,
        _read_flag(value["error_estimate"]),
    )  # fmt: skip


def _or_none(read: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda value: None if value is None else read(value)


_READERS: Mapping[str, Callable[[Any], Any]] = {
    **dict.fromkeys(("system",), _read_path),
    **dict.fromkeys(("requirements", "disturbance", "fmus", "inputs", "faults", "source"), _or_none(_read_path)),
    "parameters": lambda value: tuple(_read_path(one) for one in value),
    **dict.fromkeys(("apart", "observe", "anew"), _read_texts),
    **dict.fromkeys(("duration_s", "step_s", "storage_step_s", "checkpoint_s"), _or_none(_read_number)),
    "seed": _read_whole,
    "scheme": _read_scheme,
    **dict.fromkeys(("profile", "figures", "outside"), _read_flag),
    "isolation": _or_none(_read_isolation),
}
"""How each option is read; others, such as the bar of progress, do not count."""
