"""The system as data: components, their connectors and parameters, and the connections between them."""

from __future__ import annotations

import difflib
import re
import unicodedata
import weakref
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import msgspec

from ..files.plain import read_bytes
from .errors import SystemFileError, UsageError
from .unpacked import make_temporary, remove_temporary
from .values import End, Hop, Items, Unit, Value

MOST_NAMED = 4  # in a message
COMPONENT_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


class PortName(NamedTuple):
    """A variable of a component, written ``component.variable`` (both may contain dots).

    A component in a system inside the system is ``system.component``; one without a name is the system itself.
    """

    component: str
    variable: str

    def __str__(self) -> str:
        return f"{self.component}.{self.variable}" if self.component else self.variable


@dataclass(frozen=True)
class Connector:
    """A variable as the system description declares it; ``type`` and ``unit`` are None where it is silent."""

    name: str
    kind: str
    type: str | None
    unit: str | None
    line: int
    end: End = End()
    """Its unit and enumeration as the description defines them."""


@dataclass(frozen=True)
class Parameter:
    """A start value for a parameter or an input; ``origin`` says where it comes from."""

    value: Value
    unit: str | None
    origin: str
    notes: frozenset[str] = frozenset()
    """Types of the annotations at the value."""
    defined: Unit | None = None
    """What the file says of the unit."""
    items: Items | None = None
    """Those of the enumeration of which the value is the name of an item; not None for such a value."""
    hops: tuple[Hop, ...] = ()
    """Mappings and connections on its way to the variable."""
    bound: bool = False
    """Whether a parameter binding of the system gives it: a name that the FMU has not is ignored then."""


@dataclass(frozen=True)
class Component:
    """An FMU in the system; ``source`` is the file."""

    name: str
    source: Path
    connectors: tuple[Connector, ...]
    parameters: Mapping[str, Parameter]
    line: int
    step: float | None = None
    """Its step [s], as the description states it."""
    variables: frozenset[str] | None = None
    """Those of an FMU that replaces another one: start values for other names are left out.  None: any name counts."""


@dataclass(frozen=True)
class Connection:
    """Signal path from an output to an input."""

    source: PortName
    target: PortName
    line: int
    hops: tuple[Hop, ...] = ()
    """From connector to connector; none means straight from the source to the target."""
    file: str = ""
    """The description, where it is not that of the system itself."""

    @property
    def where(self) -> str:
        """File and line."""
        return f"{self.file}, line {self.line}" if self.file else f"line {self.line}"


@dataclass(frozen=True)
class SystemInput:
    """A connector of the system that feeds inputs of components."""

    name: str
    end: End
    targets: tuple[tuple[PortName, tuple[Hop, ...]], ...]
    line: int


@dataclass(frozen=True)
class SystemOutput:
    """A connector of the system that shows an output of a component."""

    name: str
    end: End
    source: PortName
    hops: tuple[Hop, ...]
    line: int


@dataclass(frozen=True)
class Experiment:
    """Default experiment: start and stop time and communication step [s], None where nothing is stated."""

    start_time: float = 0.0
    stop_time: float | None = None
    step: float | None = None


class ParameterSet(Mapping[str, Value]):
    """Values by name as read from a file."""

    def __init__(self, entries: Mapping[str, Parameter]) -> None:
        self._entries = dict(entries)

    def __getitem__(self, name: str) -> Value:
        return self._entries[name].value

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def entries(self) -> dict[str, Parameter]:
        """The same with the units and annotations that the file states."""
        return dict(self._entries)


@dataclass(frozen=True)
class System:
    """The content of a system description; no FMU is loaded or opened.

    ``path``: the description, or the archive and its member; ``labels``: name and description of the system.

    Raises :class:`SystemFileError` for a name with control characters.
    """

    path: Path
    components: tuple[Component, ...]
    connections: tuple[Connection, ...]
    experiment: Experiment = Experiment()
    labels: Mapping[str, str] = field(default_factory=dict)
    unpacked: UnpackedFolder | None = field(default=None, repr=False, compare=False)
    inputs: tuple[SystemInput, ...] = ()
    outputs: tuple[SystemOutput, ...] = ()
    remarks: tuple[str, ...] = ()
    """What the files say and nobody needs, such as values for parameters that are not there."""

    def __post_init__(self) -> None:
        for component in self.components:
            if any(unicodedata.category(c) in ("Cc", "Zl", "Zp") for c in component.name):
                text = f"component {component.name!r}: control characters and line breaks cannot be in a name"
                raise SystemFileError(self.path, text)

    def component(self, name: str) -> Component:
        """Return the component of this name.  Raises :class:`UsageError` with all names if there is none."""
        for component in self.components:
            if component.name == name:
                return component
        names = ", ".join(component.name for component in self.components)
        raise UsageError(f"{self.path}: there is no component {name!r}; expected one of {names}")

    def find_port(self, name: str) -> PortName:
        """Split ``component.variable``; the component is the longest name that fits, since names may contain dots.

        Raises :class:`UsageError` if no component fits.
        """
        if (found := split_port(name, {component.name for component in self.components})) is not None:
            return found
        port = parse_port(name)
        self.component(port.component)  # raises: all that there are have been tried
        return port

    def name_members(self) -> AbstractContextManager[None]:
        """See ``UnpackedFolder.name_members``; it does nothing for a system that is not in an archive."""
        return nullcontext() if self.unpacked is None else self.unpacked.name_members()

    def with_parameters(self, values: Mapping[str, Value] | Mapping[str, Parameter]) -> System:
        """Return the same system with other start values by ``component.variable``, which replace those of the file.

        Variables and values are checked when the FMUs are opened.  If a replaced FMU lacks a variable, its value is
        left out with a remark.  Raises :class:`UsageError` for a name without a component of the system.
        """
        named = values.entries() if isinstance(values, ParameterSet) else values
        changes: dict[str, dict[str, Parameter]] = {}
        for name, value in named.items():
            entry = value if isinstance(value, Parameter) else Parameter(value, None, "given by the caller")
            try:
                port = self.find_port(name)
            except UsageError as error:
                raise UsageError(f"parameter {name!r} ({entry.origin}): {error}") from error
            changes.setdefault(port.component, {})[port.variable] = entry
        components, remarks = [], list(self.remarks)
        for c in self.components:
            own = changes.get(c.name, {})
            if left := [] if c.variables is None else [name for name in own if name not in c.variables]:
                own = {name: entry for name, entry in own.items() if name not in left}
                names = list_names(left)
                remarks.append(f"{c.name}: {c.source.name} lacks the variables {names}: their values are left out")
            components.append(replace(c, parameters={**c.parameters, **own}))
        return replace(self, components=tuple(components), remarks=tuple(remarks))


class UnpackedFolder:
    """A temporary folder with the content of an archive; it is removed when nobody refers to it any longer."""

    def __init__(self, archive: Path) -> None:
        self.archive = archive
        self.path = path = make_temporary("ssp_")
        self._nested: dict[Path, Path] = {}
        weakref.finalize(self, remove_temporary, path)

    def add(self, archive: Path) -> Path:
        """A folder for the content of an archive that was in this one."""
        folder = self.path / f".nested-{len(self._nested)}"
        while folder.exists():  # a member of the archive has this name
            folder = folder.with_name(folder.name + "_")
        self._nested[folder] = archive
        return folder

    def locate(self, path: Path) -> Path:
        """A file in the folder as its user knows it: the archive, then the member; another file as it is."""
        for folder, archive in self._nested.items():
            if path.is_relative_to(folder):
                return self.locate(archive) / path.relative_to(folder)
        return self.archive / path.relative_to(self.path) if path.is_relative_to(self.path) else path

    @contextmanager
    def name_members(self) -> Iterator[None]:
        """Have errors in files of the folder name the archive and the member, not the temporary folder."""
        try:
            yield
        except SystemFileError as error:
            if not error.path.is_relative_to(self.path):
                raise
            raise SystemFileError(self.locate(error.path), error.text, error.line) from error


def split_port(name: str, components: Collection[str]) -> PortName | None:
    """``component.variable`` taken apart behind the longest of the names of components that fits; None if none does."""
    place = len(name)
    while (place := name.rfind(".", 0, place)) > 0:
        if name[:place] in components and name[place + 1 :]:
            return PortName(name[:place], name[place + 1 :])
    return None


def parse_port(name: str) -> PortName:
    """``component.variable`` taken apart.  Raises :class:`UsageError` for a name of another form."""
    component, dot, variable = name.partition(".")
    if not (dot and variable and COMPONENT_NAME.fullmatch(component)):
        raise UsageError(f"expected a name of the form component.variable, got {name!r}")
    return PortName(component, variable)


def list_names(names: Sequence[str]) -> str:
    """Names for a message: the first few, and how many more there are."""
    more = len(names) - MOST_NAMED
    return ", ".join(names) if more <= 1 else f"{', '.join(names[:MOST_NAMED])} and {more} more"


def suggest_names(name: str, known: Iterable[str]) -> str:
    """Hint for a misspelt name: ``; did you mean a, b?``, or nothing."""
    near = difflib.get_close_matches(name, list(known), n=3, cutoff=0.6)
    return f"; did you mean {', '.join(near)}?" if near else ""


# --- A flat system as JSON --------------------------------------------------------------------------------------------

MAXIMUM_BYTES = 2**30

WHERE = "the system of the study"
"""Instead of files and lines, in messages."""


def encode_system(system: System, files: Mapping[str, str]) -> bytes:
    """The system as JSON; ``files``: what the FMU of each component is called there, by the name of the component."""
    plain = replace(
        system, path=Path(WHERE), labels={}, unpacked=None, remarks=(),
        components=tuple(_simplify(one, files[one.name]) for one in system.components),
        connections=tuple(replace(one, line=0, file=WHERE, hops=_forget(one.hops)) for one in system.connections),
        inputs=tuple(
            replace(one, line=0, targets=tuple((port, _forget(hops)) for port, hops in one.targets))
            for one in system.inputs
        ),
        outputs=tuple(replace(one, line=0, hops=_forget(one.hops)) for one in system.outputs),
    )  # fmt: skip
    return msgspec.json.format(msgspec.json.encode(plain, enc_hook=str), indent=1)


def decode_system(path: Path) -> System:
    """The system that :func:`encode_system` has written into a file, beside which its FMUs are.

    Raises :class:`SystemFileError` for a file that is not there or damaged, or names an FMU outside its folder.
    """

    def find_inside(_kind: type, name: Any) -> Path:
        place = PurePosixPath(name)
        if place.is_absolute() or ".." in place.parts:
            raise ValueError(f"{name!r} is not a path inside the folder")
        return (path.parent / place).absolute()

    content = read_bytes(path, MAXIMUM_BYTES)
    try:
        return replace(msgspec.json.decode(content, type=System, dec_hook=find_inside), path=Path(WHERE))
    except (ValueError, TypeError, RecursionError) as error:
        raise SystemFileError(path, f"is not a system of a study: {error!r}") from error


def _simplify(component: Component, source: str) -> Component:
    """A component without what only messages need."""
    connectors = tuple(replace(one, line=0) for one in component.connectors)
    entries = component.parameters.items()
    parameters = {
        name: replace(entry, origin=WHERE, notes=frozenset(), hops=_forget(entry.hops)) for name, entry in entries
    }
    return replace(component, source=Path(source), connectors=connectors, parameters=parameters, line=0, variables=None)


def _forget(hops: Sequence[Hop]) -> tuple[Hop, ...]:
    return tuple(replace(hop, where=WHERE) for hop in hops)
