"""Builds the product's FMUs where they are missing or older than their sources.

A checkout has them in ``build/fmus``.  For an installed package they are made on first use, in the cache folder of the
user.
"""

from __future__ import annotations

import hashlib
import os
import sys
from pathlib import Path

from ..product.files import find_product

# Parts of the package that are packed into an FMU, and the builder itself.
_PACKED = (
    *(f"src/ps_fmu/{room}" for room in ("mechanism", "control", "disturbance", "sensors", "actuators", "interface")),
    *(f"src/ps_fmu/{room}" for room in ("numerics", "native", "slavekit")),
    "fmus",
)
_CACHE_HINT = "Set XDG_CACHE_HOME to a folder for the FMUs that are built."


def list_models(root: Path) -> list[str]:
    """Names of the FMUs whose sources ``root`` has: ``fmus/manipulator_plant`` makes ``ManipulatorPlant``."""
    return [_name_model(folder) for folder in _list_folders(root)]


def find_newest_source(root: Path) -> float:
    """Time of the last change [s since the epoch] among the sources of the FMUs in the checkout ``root``."""
    files = [os.path.join(root, "src", "ps_fmu", "__init__.py")]
    for part in _PACKED:
        for folder, inner, names in os.walk(root / part):
            inner[:] = [name for name in inner if name != "__pycache__"]
            files += [os.path.join(folder, name) for name in names]
    return max((os.stat(file).st_mtime for file in files if os.path.isfile(file)), default=0.0)


def list_outdated(folder: Path, root: Path) -> list[str]:
    """FMUs that are missing from ``folder`` or older than the sources in ``root``."""
    newest = find_newest_source(root)
    files = {name: folder / f"{name}.fmu" for name in list_models(root)}
    return [name for name, path in files.items() if not path.is_file() or path.stat().st_mtime < newest]


def ensure_built(folder: Path, root: Path) -> list[str]:
    """Build the FMUs into ``folder`` if any is out of date; returns the names of those that were.

    Raises what :func:`ps_fmu.slavekit.pack.build.build_all` raises.
    """
    stale = list_outdated(folder, root)
    if stale:
        from ..slavekit.pack.build import build_all

        build_all(folder, root / "fmus")
    return stale


def find_built_folder() -> Path:
    """Folder of the product's FMUs: ``build/fmus`` of the checkout, or that of an installed package in the cache.

    The latter has a name made from all that an FMU depends on; so FMUs in it are never out of date.

    Raises FileNotFoundError as :func:`ps_fmu.product.files.find_product`.
    """
    product = find_product()
    if product.in_checkout:
        return product.root / "build" / "fmus"
    return find_cache() / f"fmus-{_compute_key(product.root.parent)[:16]}"


def find_cache() -> Path:
    """``ps_fmu`` in the user's folder for what can be made again (XDG Base Directory Specification 0.8).

    Raises OSError if the user has no home.
    """
    stated = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if stated.is_absolute():  # the specification has others ignored
        return stated / "ps_fmu"
    try:
        return Path.home() / ".cache" / "ps_fmu"
    except RuntimeError as error:
        raise OSError(f"{error} {_CACHE_HINT}") from error


def is_own(system: Path) -> bool:
    """Whether a system description is one of ps_fmu, whose FMUs it can build."""
    try:
        return system.suffix.lower() == ".ssd" and system.resolve().parent == find_product().system.resolve()
    except FileNotFoundError:
        return False


def choose_fmus(system: Path, folder: Path | None = None, *, outside: bool = False) -> Path | None:
    """Where the FMUs of a system are sought first; None: where the system says.

    That is the ``folder`` of the user, if there is one.  It is the folder of ps_fmu's own FMUs for a description of
    ps_fmu, and for one of the user whose FMUs are not all where it says, but are ps_fmu's.  ``outside``: as
    :func:`ps_fmu.cosim.read_system`.
    """
    if folder is not None or system.suffix.lower() in (".ssp", ".fmu"):
        return folder
    if not is_own(system):
        from ..cosim.errors import CosimError, MissingFmuError
        from ..cosim.ssp.reading import read_any_system

        try:
            read_any_system(system, outside=outside)
            return None
        except MissingFmuError as error:
            if error.fmu.stem not in list_models(find_product().root):
                return None
        except CosimError:
            return None  # whoever reads the system says what is wrong
    return find_built_folder()


def provide_fmus(folder: Path | None, system: Path | None = None) -> None:
    """Have the product's FMUs in a folder, up to date.

    Parameters
    ----------
    folder: by :func:`find_built_folder`, or one that the user names; None: nothing is built.
    system: a system description as :func:`ps_fmu.cosim.read_system` takes it; an installed package builds only the
        FMUs that it names.

    Raises BuildError, OSError, and CosimError for a system that cannot be read.
    """
    product = find_product()
    if folder is None:
        return
    if product.in_checkout:
        ensure_built(folder, product.root)
        return
    missing = [
        path for path in _list_folders(product.root) if not (folder / f"{_name_model(path)}.fmu").is_file()
    ]
    if missing and system is not None:
        if system.suffix.lower() == ".ssp":
            return  # it brings its own
        from ..cosim.ssp.reading import list_fmu_files

        wanted = list_fmu_files(system)
        missing = [path for path in missing if f"{_name_model(path)}.fmu" in wanted]
    if missing:
        from ..slavekit.pack.build import build_one

        if folder.parent == find_cache():
            _make_private(folder.parent)
        for path in missing:  # each is written in one go: others may build the same
            print(f"building {_name_model(path)}.fmu, once, into {folder}", file=sys.stderr, flush=True)
            build_one(path, folder)


def _list_folders(root: Path) -> list[Path]:
    scripts = sorted((root / "fmus").glob("*/*.py"))
    return [path.parent for path in scripts if path.stem == path.parent.name]


def _name_model(folder: Path) -> str:
    return folder.name.title().replace("_", "")


def _make_private(folder: Path) -> None:
    """Make the cache; FMUs are programs, and only the user puts any there."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        error.add_note(_CACHE_HINT)
        raise


def _compute_key(package: Path) -> str:
    """Digest of the files of the installed package, of pythonfmu's version and of Python's, in hexadecimal."""
    from importlib import metadata  # only an installed package needs it

    digest = hashlib.sha256(f"{metadata.version('pythonfmu')} {sys.version_info[:2]}".encode())
    for path in sorted(package.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            content = path.read_bytes()
            digest.update(f"\0{path.relative_to(package).as_posix()}\0{len(content)}\0".encode())
            digest.update(content)
    return digest.hexdigest()
