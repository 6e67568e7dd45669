"""What every FMU gets, by whomever its slave is: its modules, the launcher, notes, licences, perhaps a Python."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path, PurePosixPath

from ...files.archive import compute_digest
from ...native import list_platforms, read_compiled
from ..author.description import make_guid
from .bundle import bundle
from .errors import BuildError
from .licenses import License, write_licenses
from .modules import pack_modules
from .sources import Files

PACKAGE = Path(__file__).resolve().parents[2]
RESOURCES, DOCUMENTATION = PurePosixPath("resources"), PurePosixPath("documentation")
OLDEST_PYTHON = "3.11"
_WRAPPER = {".so": "libpythonfmu-export.so", ".dll": "pythonfmu-export.dll"}  # names that the launcher looks for

_NEEDED = """\
What {model}.fmu needs of the machine

CPython {python} or later with {modules}.

Linux x86-64: in a host that runs Python, that Python. Other hosts need not be prepared: the FMU starts a Python, and
looks for it in this order:
  1. PS_FMU_PYTHON=/path/to/python3 in the environment; then nothing else is tried;
  2. the interpreter that it was built with a note of, if any (ps-fmu build --interpreter);
  3. the virtual environment in VIRTUAL_ENV;
  4. python3 on PATH.
It needs a shared libpython (Debian and Ubuntu: package libpython3.x).
If none is fit, fmi2Instantiate fails with one message that says for each why not.

glibc 2.32 or later and the libstdc++ of GCC 12 or later, for pythonfmu's library.

Windows x86-64: the same with python.exe and py.exe in place of python3; python3.dll beside the interpreter's library;
the Microsoft Visual C++ runtime. It was run under Wine, never on Windows.
"""

_BUNDLED = """\
What {model}.fmu needs of the machine

Linux x86-64: {libc} or later, and the libstdc++ of GCC 12 or later. CPython with {modules} is in the FMU.

Other systems: CPython {python} or later with {modules}.
"""


def check_interpreter(interpreter: Path | None) -> None:
    """Raise BuildError if this is not a program."""
    if interpreter is not None and not (interpreter.is_file() and os.access(interpreter, os.X_OK)):
        raise BuildError(f"--interpreter: expected the path of a Python, got {interpreter}")


def name_package(sources: Files) -> str:
    """The name that ``ps_fmu`` has in FMUs which share these of its files: they load each module once in a process."""
    return f"ps_fmu_{compute_digest(sources).hex()[:12]}"


def add_modules(files: Files, package: str, inside: Files, entry: str, write_entry: Callable[[str], bytes]) -> None:
    """Add the package of ps_fmu and the script that pythonfmu's library starts from.

    Parameters
    ----------
    inside: the package's files, by their place in it.
    write_entry: makes the script ``entry`` from the name of the archive with the modules.
    """
    archived, packed = pack_modules(package, inside)
    for name, content in packed.items():
        files[RESOURCES / package / name] = content
    files[RESOURCES / f"{entry}.py"] = write_entry(archived)
    files[RESOURCES / "slavemodule.txt"] = entry.encode()


def add_notes(
    files: Files, model: str, digest: bytes, needed: Sequence[str], licenses: Iterable[License], part: str = "",
    *, interpreter: Path | None, bundled: bool, requirements: Sequence[str] = (),
) -> str:  # fmt: skip
    """Add what the launcher and users have to know, the licences, and on demand a Python; the FMU's GUID.

    Parameters
    ----------
    digest: of the FMU's content; the GUID says it.
    needed, requirements: packages that the slave imports, and others of its by the names of their distributions.
    part: folder of the licences, see :func:`.licenses.write_licenses`.
    """
    guid, texts = make_guid(digest), list(licenses)
    files[RESOURCES / "launcher.txt"] = _write_notes(guid, needed, interpreter)
    files.setdefault(DOCUMENTATION / "externalDependencies.txt", write_external_dependencies(model, needed, bundled))
    if bundled:
        runtime = bundle(needed, requirements)
        texts += runtime.licenses
        files |= {PurePosixPath("binaries/linux64") / name: content for name, content in runtime.files.items()}
    files |= write_licenses(texts, part)
    return guid


def put_launcher_in_front(files: Files, model: str) -> Files:
    """The files in ``binaries``: where there is a launcher, it takes the name that hosts look for, ``model``.

    pythonfmu's libraries stay as they are, under the name that the launcher looks for.  Raises BuildError if a launcher
    is not the one that was recorded when it was made: in an FMU nobody could tell.
    """
    result = {name: content for name, content in files.items() if name.parts[0] == "binaries"}
    try:
        for platform in list_platforms("launcher"):
            for name in [name for name in result if name.parent.name == platform and name.stem == model]:
                result[name.with_name(_WRAPPER[name.suffix])] = result[name]
                _, result[name] = read_compiled("launcher", platform)
    except OSError as error:
        raise BuildError(str(error)) from error
    return result


def _write_notes(guid: str, modules: Sequence[str], interpreter: Path | None) -> bytes:
    """Which FMU this is, and what a Python has to have for it."""
    lines = [f"guid={guid}", f"python={OLDEST_PYTHON}"]
    if modules:
        lines.append(f"modules={' '.join(modules)}")
    if interpreter is not None:
        lines.append(f"interpreter={interpreter.absolute()}")
    return ("\n".join(lines) + "\n").encode()


def write_external_dependencies(model: str, modules: Sequence[str], bundled: bool) -> bytes:
    """The file ``documentation/externalDependencies.txt`` (FMI 2.0.4, 2.3): what an FMU needs of the machine.

    ``modules``: packages that the slave imports; ``bundled``: the FMU brings them.
    """
    names = " and ".join(modules) or "its standard library"
    libc = (os.confstr("CS_GNU_LIBC_VERSION") or "glibc") if bundled else ""
    text = _BUNDLED if bundled else _NEEDED
    return text.format(model=model, python=OLDEST_PYTHON, modules=names, libc=libc).encode()
