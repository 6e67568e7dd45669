"""What Ecos needs before it can be imported."""

import ctypes
from importlib.metadata import files
from pathlib import Path


def load_tbb() -> None:
    """Ecos is linked to libtbb.so.12 and does not bring it; PyPI's tbb does, in a folder that no loader searches."""
    for file in files("tbb") or ():
        if file.name == "libtbb.so.12":
            ctypes.CDLL(str(Path(file.locate()).resolve()), ctypes.RTLD_GLOBAL)
