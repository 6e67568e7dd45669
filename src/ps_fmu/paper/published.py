"""The numbers that the paper publishes, from ``published.toml``: the one place where they are written down."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

RELATIONS = ("=", ">", "<", "~")
ANGLES = ("roll", "pitch", "yaw")  # as the keys of Table 1 and the orientations name them


@dataclass(frozen=True)
class PublishedNumber:
    """A number of the paper."""

    key: str
    """``group.name`` in published.toml."""
    where: str
    """Section, figure or table."""
    what: str
    unit: str
    value: float
    relation: str = "="
    """``"="``: the paper gives this value; ``">"`` or ``"<"``: it says that the number is above or below; ``"~"``: it
    gives an order of magnitude."""
    remark: str = ""

    def __post_init__(self) -> None:
        if self.relation not in RELATIONS:
            raise ValueError(f"published.toml: {self.key}: relation {self.relation!r}, expected one of {RELATIONS}")

    @property
    def text(self) -> str:
        """The value with its relation, as in a table."""
        return f"{self.value:g}" if self.relation == "=" else f"{self.relation} {self.value:g}"


@cache
def published_numbers() -> dict[str, PublishedNumber]:
    """All published numbers by key, such as ``table1.roll_max``, in the order of the file: that of the paper."""
    text = files(__package__).joinpath("published.toml").read_text(encoding="utf-8")
    numbers = {
        f"{group}.{name}": PublishedNumber(f"{group}.{name}", **entry)
        for group, entries in tomllib.loads(text).items()
        for name, entry in entries.items()
    }
    return dict(sorted(numbers.items(), key=lambda item: text.index(f"[{item[0]}]")))  # groups may be interleaved
