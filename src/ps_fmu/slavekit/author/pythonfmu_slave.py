"""A slave of another author inside an FMU: written for pythonfmu alone, it runs as it is.

:func:`load_slave` gives its modules names of their own, so that several FMUs in one process do not share them, and
:func:`protect` puts a border around its class, see :mod:`.guard`.  The author's files are not changed.
"""

from __future__ import annotations

import builtins
import functools
import importlib
import inspect
import os
import sys
import threading
from collections.abc import Callable, Collection, Sequence
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import ModuleType
from typing import Any, ClassVar
from weakref import WeakValueDictionary

from .guard import FmuError, Refused, Unreadable, describe, keep_alive, raise_compensated, report

_CORE_REFERENCE = 2**31 - 1  # the launcher asks for this String; see core.REFERENCE, which needs numpy
_CALLS = ("setup_experiment", "enter_initialization_mode", "exit_initialization_mode", "terminate")
_CONVERT: dict[str, Callable[[Any], Any]] = {"real": float, "integer": int, "boolean": bool, "string": str}
_new = threading.local()
"""``begun``: this thread instantiates; otherwise a constructor is called by fmi2Reset."""


# --- Modules ----------------------------------------------------------------------------------------------------------


class _Loader(SourceFileLoader):
    """Runs a module with an ``__import__`` of its own."""

    def __init__(self, name: str, path: str, import_: Callable[..., Any]) -> None:
        super().__init__(name, path)
        self._import = import_

    def exec_module(self, module: ModuleType) -> None:
        """Run the module; its functions keep these builtins."""
        module.__dict__["__builtins__"] = {**vars(builtins), "__import__": self._import}
        super().exec_module(module)


class _Finder:
    """Finds the modules of one FMU below the package ``package``; an entry of ``sys.meta_path``."""

    def __init__(self, package: str, names: Collection[str]) -> None:
        self.package = package
        self._names = frozenset(names)

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        """As those of Python's finders; None for modules of others."""
        if not name.startswith(f"{self.package}."):
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and type(spec.loader) is SourceFileLoader:
            spec.loader = _Loader(name, spec.loader.path, self._import)
        return spec

    def _import(
        self, name: str, globals: Any = None, locals: Any = None, fromlist: Sequence[str] | None = (), level: int = 0
    ) -> Any:
        """``__import__`` of the FMU's modules: the names of the FMU's own files lead to these files."""
        top = name.partition(".")[0]
        if level or top not in self._names:
            return builtins.__import__(name, globals, locals, fromlist or (), level)
        package = builtins.__import__(f"{self.package}.{name}", globals, locals, fromlist or (), 0)
        return package if fromlist else sys.modules[f"{self.package}.{top}"]


def load_slave(package: str, names: Collection[str], script: str, folder: str) -> type:
    """The slave's class, protected.

    Parameters
    ----------
    package: name under which the FMU's modules are kept; made from the FMU's content.
    names: top-level modules and packages in the FMU's resources.
    script: the module among them that has the slave.
    folder: the FMU's resources.

    Raises whatever the author's modules raise.
    """
    root = sys.modules.get(package)
    if root is None or not os.path.isdir(root.__path__[0]):
        # In a folder that is gone, what the author's modules read later would be missing: they are loaded again.
        for name in [name for name in sys.modules if (name + ".").startswith(f"{package}.")]:
            del sys.modules[name]
        root = ModuleType(package)
        root.__path__ = [folder]
        sys.meta_path[:] = [finder for finder in sys.meta_path if getattr(finder, "package", None) != package]
        sys.meta_path.insert(0, _Finder(package, names))
        sys.modules[package] = root
        importlib.invalidate_caches()
    if folder not in sys.path:
        sys.path.append(folder)  # for modules that are asked for in other ways than by import statements
    if "slave" not in vars(root):
        root.slave = protect(_find_class(importlib.import_module(f"{package}.{script}")))  # type: ignore[attr-defined]
    _new.begun = True
    slave: type = root.slave
    return slave


def _find_class(module: ModuleType) -> type:
    """The class that pythonfmu takes: the one that is farthest from Fmi2Slave, the first of several."""
    classes = [value for value in vars(module).values() if isinstance(value, type)]
    depth = {cls: [base.__name__ for base in cls.__mro__].index("Fmi2Slave") for cls in classes if _is_slave(cls)}
    if not depth:
        raise Refused(f"{module.__file__} defines no class that derives from pythonfmu's Fmi2Slave")
    return max(depth, key=lambda cls: depth[cls])


def _is_slave(cls: type) -> bool:
    return any(base.__name__ == "Fmi2Slave" for base in cls.__mro__[1:]) and not inspect.isabstract(cls)


# --- The border -------------------------------------------------------------------------------------------------------


def _guard(method: Callable[..., Any]) -> Callable[..., Any]:
    """``method``, whose exceptions are reported, and made harmless where pythonfmu's library makes the call."""

    @functools.wraps(method)
    def call(self: Any, *arguments: Any) -> Any:
        try:
            if self._ps_fmu_failure is not None:
                raise Refused(self._ps_fmu_failure)
            return method(self, *arguments)
        except FmuError:
            raise
        except BaseException as error:
            _cut(error)
            if self._ps_fmu_hosted:
                raise_compensated(self, self._ps_fmu_label, self._ps_fmu_queue, error)
            raise

    return call


def _cut(error: BaseException) -> None:
    """Leave the frames of this file out of the traceback: it begins with the author's."""
    trace = error.__traceback__
    while trace is not None and trace.tb_frame.f_globals is globals():
        trace = trace.tb_next
    error.__traceback__ = trace


class _Border:
    """Methods that take the place of the author's, see :func:`protect`."""

    _ps_fmu_model: ClassVar[Any]
    """The author's class."""
    _ps_fmu_instances: ClassVar[WeakValueDictionary[int, Any]]
    _ps_fmu_failure: str | None = None
    """Why the constructor failed, where the library cannot bear an exception."""

    def __init__(self, **settings: Any) -> None:
        resetting = not getattr(_new, "begun", False)
        _new.begun = False
        self._ps_fmu_hosted = "logger" in settings  # only pythonfmu's library passes one
        self._ps_fmu_label = f"{type(self).__name__} {settings.get('instance_name')!r}"
        self._ps_fmu_queue: list[Any] = []
        try:
            self._ps_fmu_model.__init__(self, **settings)
        except BaseException as error:
            _cut(error)
            if not self._ps_fmu_hosted:
                raise
            text = report(f"{self._ps_fmu_label}: {describe(error)}", error)
            if not resetting:
                raise FmuError(text.replace("%", "%%")) from error
            self._ps_fmu_failure = f"the reset has failed: {describe(error)}"
        self._ps_fmu_instances[id(self)] = self

    def _get_log_queue(self) -> Any:
        if self._ps_fmu_failure is None:
            self._ps_fmu_queue = self._ps_fmu_model._get_log_queue(self)
        return self._ps_fmu_queue

    def log(self, msg: Any, *arguments: Any, **settings: Any) -> None:
        """Hosts take the text for a printf format.  The library never frees a text, so equal ones are one object."""
        self._ps_fmu_model.log(self, sys.intern(str(msg).replace("%", "%%")), *arguments, **settings)

    @_guard
    def do_step(self, current_time: float, step_size: float) -> bool:
        """Make a step; the result is a bool, which the library can test without an exception."""
        return bool(self._ps_fmu_model.do_step(self, current_time, step_size))

    @_guard
    def _set_fmu_state(self, state: Any) -> None:
        if isinstance(state, Unreadable):
            raise Refused(state.why)
        self._ps_fmu_model._set_fmu_state(self, state)

    @classmethod
    def _fmu_state_to_bytes(cls, state: Any) -> bytes:
        """None at all of what is unreadable: by that the launcher knows it."""
        if isinstance(state, Unreadable):
            return b""
        try:
            return bytes(cls._ps_fmu_model._fmu_state_to_bytes(state))
        except BaseException as error:
            _cut(error)
            hosted = [slave for slave in cls._ps_fmu_instances.values() if slave._ps_fmu_hosted]
            for slave in hosted:  # which of them it is about is not known
                keep_alive(slave, slave._ps_fmu_queue)
            if hosted:
                raise_compensated(hosted[0], cls.__name__, hosted[0]._ps_fmu_queue, error)
            raise

    @classmethod
    def _fmu_state_from_bytes(cls, state: bytes) -> Any:
        try:
            return cls._ps_fmu_model._fmu_state_from_bytes(state)
        except Exception as error:
            return Unreadable(f"the bytes are not an FMU state of this slave: {describe(error)}")


def protect(model: type) -> type:
    """A class that does what ``model`` does and lets no exception harm pythonfmu's library.

    If a method raises, the call is an error, with the traceback as its message.  The instance remains usable.
    """
    namespace = {name: value for name, value in vars(_Border).items() if name not in ("__dict__", "__weakref__")}
    for name in (*_CALLS, *(f"set_{kind}" for kind in _CONVERT), "_get_fmu_state"):
        namespace[name] = _guard(getattr(model, name))
    for kind in _CONVERT:
        namespace[f"get_{kind}"] = _guard(_make_getter(getattr(model, f"get_{kind}"), kind))
    namespace |= {"__doc__": model.__doc__, "__module__": model.__module__, "__qualname__": model.__qualname__}
    namespace |= {"_ps_fmu_model": model, "_ps_fmu_instances": WeakValueDictionary()}
    return type(model)(model.__name__, (model,), namespace)


def _make_getter(get: Callable[..., Any], kind: str) -> Callable[..., Any]:
    """The library reads a list and believes its length and its types: these are checked here."""
    convert = _CONVERT[kind]

    def get_checked(self: Any, references: list[int]) -> list[Any]:
        if kind == "string" and references == [_CORE_REFERENCE]:
            return ["0"]  # no words to share: the launcher passes every step on
        values = [convert(value) for value in get(self, references)]
        if len(values) != len(references):
            raise ValueError(f"get_{kind} returned {len(values)} values for {len(references)} variables")
        if kind == "string":
            for value in values:
                value.encode()  # UnicodeEncodeError here, not in the library
        return values

    return get_checked
