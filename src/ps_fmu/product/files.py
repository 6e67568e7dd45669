"""Where the product's files are: in a checkout the folders ``fmus`` and ``system``, in a wheel copies beside this file.

``setup.py`` makes these copies.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

_HERE = Path(__file__).resolve().parent


@dataclass(frozen=True)
class ProductFiles:
    """The folders with the product's files."""

    root: Path
    """Holds the folders ``fmus`` and ``system``."""
    in_checkout: bool
    """The files are those of a checkout, which people change: not the copies of a wheel."""

    @property
    def fmus(self) -> Path:
        """Sources of the FMUs, a folder for each."""
        return self.root / "fmus"

    @property
    def system(self) -> Path:
        """System descriptions, and below them the folder ``parameters``."""
        return self.root / "system"


def find_product(here: Path = _HERE) -> ProductFiles:
    """The product's files.  ``here``: the folder of this module.

    Raises FileNotFoundError if this is neither a checkout nor an installed wheel, but a copy of the package alone.
    """
    if (here / "fmus").is_dir():
        return ProductFiles(here, in_checkout=False)
    package, source = here.parents[:2]
    root = source.parent
    if (package.name, source.name) == ("ps_fmu", "src") and (root / "fmus").is_dir():
        return ProductFiles(root, in_checkout=True)
    raise FileNotFoundError(
        f"the FMUs' sources are not there: {package} is neither installed from a wheel nor part of a checkout"
    )


def find_file(path: Path) -> Path:
    """A file that the user names: their own, or else the product's file of this name.

    ``exact_payload.ssv``, ``parameters/exact_payload.ssv`` and ``system/parameters/exact_payload.ssv`` are the same
    file of the product, from any working directory.  A path that leads to neither is returned as it is.
    """
    if path.exists() or path.is_absolute() or ".." in path.parts:
        return path
    try:
        product = find_product()
    except FileNotFoundError:
        return path
    system = product.system
    places = product.root, system, system / "parameters", system / "studies", system / "faults"
    return next((place / path for place in places if (place / path).is_file()), path)


def list_system_files() -> list[str]:
    """Names of the product's system descriptions, parameters, requirements and faults, as :func:`find_file` takes them.

    None where :func:`find_product` finds none.
    """
    try:
        system = find_product().system
    except FileNotFoundError:
        return []
    places, endings = (system, system / "parameters", system / "faults"), (".ssd", ".ssv", ".toml", ".json")
    return sorted(path.name for place in places for path in place.iterdir() if path.suffix in endings)
