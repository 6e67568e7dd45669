"""The Python files of an FMU: which ones it needs, and under which names they live in it.

Modules are shared process-wide by name, so two FMUs that both carry a package ``ps_fmu`` would run the code
of whichever came first.  Inside an FMU the package therefore has another name, made from its content.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import json
import pkgutil
import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator
from functools import lru_cache
from pathlib import Path, PurePosixPath

from ...native import RECORD, list_platforms, read_compiled
from .errors import BuildError

_DOTTED_NAME = re.compile(r"[A-Za-z_]\w*(\.\w+)*", re.ASCII)
_DATA = (".toml", ".csv", ".json", ".license")
_NATIVE = PurePosixPath("ps_fmu", "native")
LIBRARIES = (".so", ".dll")

Files = dict[PurePosixPath, bytes]


@lru_cache(maxsize=1024)  # the FMUs of a folder have most of their modules in common: 2 s less for eight
def find_imports(source: str | bytes, name: str, package: str, optional: bool = True) -> frozenset[str]:
    """Absolute names of all modules, and of all names in modules, that a source imports, wherever in it.

    Parameters
    ----------
    source: the Python source.
    name: what to call it in errors.
    package: the package it is in, to resolve relative imports; ``""`` for a script.
    optional: also those that may fail: in ``try`` with handlers, and in ``if TYPE_CHECKING``.

    Raises BuildError for what is no Python.
    """
    try:
        tree = ast.parse(source, filename=name)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise BuildError(f"{name}: cannot be read as Python: {error or type(error).__name__}") from None
    found: set[str] = set()
    for node in _walk(tree, optional):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            module = node.module or ""
            if node.level:
                try:
                    module = importlib.util.resolve_name("." * node.level + module, package)
                except ImportError:
                    text = "a relative import leads out of the package: import the module by its name"
                    raise BuildError(f"{name}:{node.lineno}: {text}") from None
            found |= {module} | {f"{module}.{alias.name}" for alias in node.names}
    return frozenset(found)


def collect_modules(script: Path, roots: dict[str, Path], hollow: Collection[str] = ()) -> Files:
    """As :func:`collect_imported` for the modules that ``script`` imports; it is not part of the result itself."""
    return collect_imported(find_imports(script.read_bytes(), script.name, ""), roots, hollow)


def collect_imported(modules: Iterable[str], roots: dict[str, Path], hollow: Collection[str] = ()) -> Files:
    """Some modules and those that they import of some packages, directly or not, and the data files beside them.

    A package whose ``__init__.py`` calls ``pkgutil.iter_modules`` is taken with all its modules; with
    ``ps_fmu.native`` comes the library that modules in an FMU load.

    Parameters
    ----------
    modules: absolute names that everything starts from.
    roots: package name -> its folder.
    hollow: packages of these whose ``__init__.py`` is left out, with all that only it imports; an empty one
        stands in.

    Returns
    -------
    Files: ``package/sub/module.py`` -> content.

    Raises OSError for a library that is not the recorded one.
    """
    files: Files = {}
    waiting = sorted(modules)
    while waiting:
        name = waiting.pop()
        top, *_ = name.split(".")
        if top not in roots:
            continue
        for path in _list_module_files(name, roots[top]):
            arcname = PurePosixPath(top, path.relative_to(roots[top]).as_posix())
            if arcname in files:
                continue
            is_hollow = path.name == "__init__.py" and path.parent == roots[top] and top in hollow
            files[arcname] = b"" if is_hollow else path.read_bytes()
            package = ".".join(arcname.parent.parts)
            source = files[arcname].decode()
            waiting += sorted(find_imports(source, str(arcname), package))
            if path.name == "__init__.py":
                if _lists_its_modules(source, str(arcname)):
                    waiting += [f"{package}.{found.name}" for found in pkgutil.iter_modules([str(path.parent)])]
                for data in sorted(path.parent.iterdir()):
                    if data.is_file() and data.suffix in _DATA:
                        files[arcname.parent / data.name] = data.read_bytes()
    if _NATIVE / "__init__.py" in files:
        files |= {_NATIVE / name: content for name, content in _read_library("numerics").items()}
    return files


def _read_library(name: str) -> dict[str, bytes]:
    """A library for all platforms, and the record of it alone: an FMU does not change with the others."""
    files, made = {}, {}
    for platform in list_platforms(name):
        file, content = read_compiled(name, platform)
        files[f"{platform}/{file}"] = content
        made[platform] = {file: hashlib.sha256(content).hexdigest()}
    return files | {RECORD: json.dumps({"made": made}, indent=2).encode() + b"\n"}


def _lists_its_modules(source: str, name: str) -> bool:
    """Whether a source calls ``pkgutil.iter_modules``, by which a package finds what no import names."""
    calls = [node.func for node in ast.walk(ast.parse(source, filename=name)) if isinstance(node, ast.Call)]
    return any(isinstance(call, ast.Attribute) and call.attr == "iter_modules" for call in calls)


def _walk(tree: ast.AST, optional: bool) -> Iterator[ast.AST]:
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        yield node
        may_fail = isinstance(node, ast.Try) and node.handlers
        if optional or not (may_fail or (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test))):
            waiting.extend(ast.iter_child_nodes(node))


def find_needed_modules(script: str, files: Files) -> list[str]:
    """Top-level packages that a module in ``files`` needs, directly or not, beside these files and Python's own.

    Parameters
    ----------
    script: name of the module that everything starts from.
    files: Python sources and others, by their place below a folder in which imports are looked up.

    Raises BuildError for a source that is not Python.
    """
    needed: set[str] = set()
    for place, content in _reach(script, files.get):
        needed |= set(map(_get_top, find_imports(content, str(place), ".".join(place.parts[:-1]), optional=False)))
    own = {name.parts[0].removesuffix(".py") for name in files}
    return sorted(needed - own - sys.stdlib_module_names - {""})


def find_beside(script: Path) -> list[Path]:
    """The modules and packages beside a script that it imports, directly or not.  Raises BuildError."""

    def read(name: PurePosixPath) -> bytes | None:
        path = script.parent / name
        return path.read_bytes() if path.is_file() else None

    tops = {place.parts[0] for place, _ in _reach(script.stem, read)}
    return [script.parent / top for top in sorted(tops)]


def _reach(script: str, read: Callable[[PurePosixPath], bytes | None]) -> Iterator[tuple[PurePosixPath, bytes]]:
    """A module and those that it imports, directly or not, as far as ``read`` has their sources; with these."""
    seen: set[PurePosixPath] = set()
    waiting = [script]
    while waiting:
        parts = waiting.pop().split(".")
        for n in range(1, len(parts) + 1):
            module = PurePosixPath(*parts[:n])
            for place in (module / "__init__.py", module.with_suffix(".py")):
                content = None if place in seen else read(place)
                if content is None:
                    continue
                seen.add(place)
                waiting += find_imports(content, str(place), ".".join(place.parts[:-1]))
                yield place, content


def _list_module_files(name: str, folder: Path) -> Iterator[Path]:
    """The files that an import of ``a.b.c`` executes: each package's, and the module's own."""
    yield folder / "__init__.py"
    for part in name.split(".")[1:]:
        if (folder / part / "__init__.py").is_file():
            folder = folder / part
            yield folder / "__init__.py"
        else:
            if (folder / f"{part}.py").is_file():
                yield folder / f"{part}.py"
            return


def rename_imports(source: bytes, name: str, names: dict[str, str]) -> bytes:
    """A source whose absolute imports of some packages go to other names.

    Parameters
    ----------
    source: Python source, UTF-8.
    name: what to call it in errors.
    names: top-level package -> new name, which may be dotted.

    Raises BuildError where the source refers to such a package in a way that cannot be rewritten.
    """
    lines = source.decode().splitlines(keepends=True)
    for node in ast.walk(ast.parse(source, filename=name)):
        if isinstance(node, ast.ImportFrom) and node.level == 0 and _get_top(node.module) in names:
            _rename_from(lines, node, names)
        elif isinstance(node, ast.Import):
            for alias in node.names:
                if _get_top(alias.name) in names:
                    raise BuildError(f"{name}:{node.lineno}: 'import {alias.name}': write 'from ... import ...'")
        elif (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and _DOTTED_NAME.fullmatch(node.value)
            and _get_top(node.value) in names
        ):
            text = "looks like the name of a module, which has another name in an FMU"
            raise BuildError(f"{name}:{node.lineno}: {node.value!r} {text}")
    return "".join(lines).encode()


def _get_top(module: str | None) -> str:
    return (module or "").partition(".")[0]


def _rename_from(lines: list[str], node: ast.ImportFrom, names: dict[str, str]) -> None:
    """Rename the module of ``from module import ...``, which may stand on a continued line."""
    for i in range(node.lineno - 1, node.end_lineno or node.lineno):
        start = len(lines[i].encode()[: node.col_offset].decode()) if i == node.lineno - 1 else 0
        head, tail = lines[i][:start], lines[i][start:]
        old = _get_top(node.module)
        new, n = re.subn(rf"\b{old}\b", names[old], tail, count=1)
        if n:
            lines[i] = head + new
            return
