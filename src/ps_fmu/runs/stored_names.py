"""Names in results.nc for outputs of any name."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from ..cosim.rows import Column

_LONGEST = 240
"""Bytes of a name; netCDF has 256, and some are for numbers that tell equal beginnings apart."""
_FORBIDDEN = re.compile(r"[/\x00-\x1f\x7f]")


def make_stored_names(names: Sequence[str], taken: Collection[str] = ("time",)) -> dict[str, str]:
    """Names of netCDF variables for columns of any name, each once: netCDF has no slashes nor control characters.

    It begins with a letter, digit or underscore, ends with no space and is in Unicode's normal form C (NetCDF Users
    Guide, appendix B).  Long ones, as of Modelica, are cut.  None is one of those that are ``taken``.
    """
    stored: dict[str, str] = {}
    known = set(taken)
    for name in names:
        plain = unicodedata.normalize("NFC", _FORBIDDEN.sub("_", name)).rstrip()
        if not plain or (ord(plain[0]) < 128 and not (plain[0].isalnum() or plain[0] == "_")):
            plain = f"_{plain}"
        plain = plain.encode()[:_LONGEST].decode(errors="ignore").rstrip()
        unique, number = plain, 2
        while unique in known:
            unique, number = f"{plain}_{number}", number + 1
        known.add(unique)
        stored[name] = unique
    return stored


def rename_columns(columns: Sequence[Column], stored: Mapping[str, str] | None = None) -> list[Column]:
    """The columns as a file has them: one of another name than in the system says that in its description.

    ``stored``: of :func:`make_stored_names`, for all columns of the run; None: these are all.
    """
    names = make_stored_names([column.name for column in columns]) if stored is None else stored
    return [
        replace(column, name=names[column.name], description=_describe(column, names[column.name]))
        for column in columns
    ]


def _describe(column: Column, stored: str) -> str:
    return column.description if stored == column.name else f"{column.name}: {column.description}".rstrip(": ")
