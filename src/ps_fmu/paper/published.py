"""The numbers that the paper publishes, from ``published.toml``: the one place where they are written down."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

RELATIONS = ("=", ">", "<", "~")


@dataclass(frozen=True)
class Published:
    """A number of the paper.

    ``relation``: ``"="`` a value; ``">"``, ``"<"`` what is said to be exceeded, or not to be reached; ``"~"`` an order
    of magnitude.
    """

    key: str
    where: str
    what: str
    unit: str
    value: float
    relation: str = "="
    remark: str = ""

    def __post_init__(self) -> None:
        if self.relation not in RELATIONS:
            raise ValueError(f"published.toml: {self.key}: relation {self.relation!r}, expected one of {RELATIONS}")

    @property
    def text(self) -> str:
        """The value as the paper would write it, with its relation."""
        return f"{self.value:g}" if self.relation == "=" else f"{self.relation} {self.value:g}"


@cache
def published() -> dict[str, Published]:
    """All published numbers by key, such as ``table1.roll_max``, in the order of the file."""
    text = files(__package__).joinpath("published.toml").read_text(encoding="utf-8")
    found = {
        f"{group}.{name}": Published(f"{group}.{name}", **entry)
        for group, entries in tomllib.loads(text).items()
        for name, entry in entries.items()
    }
    return dict(sorted(found.items(), key=lambda item: text.index(f"[{item[0]}]")))  # groups may be interleaved
