"""Quantities of the parameter dataclasses: units and bounds, checks, and their scalars by name.

A parameter dataclass states each field with :func:`quantity`, checks it in ``__post_init__`` and is frozen.
:func:`list_entries` lists its scalars, :func:`replace_values` makes a copy with other values.  The names are those of
the FMI parameters: dotted, without brackets.  A tuple ``fine_legs`` becomes ``fine_leg_1``, ``fine_leg_2`` ..., a
vector ``com_P`` becomes ``com.x``, ``com.y``, ``com.z`` (the frame is in the description), a symmetric matrix its
upper triangle ``inertia.xx``, ``inertia.xy`` ...
"""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
T = TypeVar("T")

#: Magnitudes between which products and quotients of six numbers are still finite and not zero: a double ends at 1e308.
SMALLEST, LARGEST = 1e-50, 1e50

AXES = ("x", "y", "z")
QUATERNION = ("w", "x", "y", "z")
WRENCH_AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
TWIST_AXES = ("tx", "ty", "tz", "rx", "ry", "rz")


class ParameterError(ValueError):
    """A parameter that cannot be used; the text starts with its name, for example ``payload.mass``."""

    def __init__(self, name: str, problem: str) -> None:
        super().__init__(f"{name}: {problem}")
        self.name = name
        self.problem = problem


def quantity(
    unit: str,
    description: str,
    *,
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
    display: str | None = None,
    shape: tuple[int, ...] | None = None,
    default: Any = MISSING,
) -> Any:
    """A dataclass field with its unit and description.

    A number also has its bounds and the unit to display it in, an array its shape.
    """
    bounds = {"above": above, "at_least": at_least, "at_most": at_most}
    about = {"unit": unit, "description": description, "bounds": bounds, "display": display, "shape": shape}
    return field(default=default, metadata=about)


def group(*, flat: bool = False, keep: Callable[[str], bool] | None = None) -> Any:
    """A dataclass field that holds other parameter dataclasses.

    Parameters
    ----------
    flat: the names of what is inside begin without the name of the field.
    keep: the names for which it is true are listed; the others keep their values.
    """
    return field(metadata={"flat": flat, "keep": keep})


def freeze(value: Any, shape: tuple[int, ...], name: str) -> Array:
    """A read-only array of numbers up to LARGEST.  Raises ParameterError, naming ``name``, for anything else."""
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise ParameterError(name, f"expected numbers of shape {shape}, got {reprlib.repr(value)}") from error
    if array.shape != shape:
        raise ParameterError(name, f"expected shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise ParameterError(name, f"every number must be finite, got {array.tolist()}")
    if (np.abs(array) > LARGEST).any():
        raise ParameterError(name, f"no number may be beyond {LARGEST:g}, got {array.tolist()}")
    array.setflags(write=False)
    return array


def check_number(
    value: Any, name: str, *, above: float | None = None, at_least: float | None = None, at_most: float | None = None
) -> float:
    """A number within bounds, zero or of a magnitude that can be multiplied.

    Raises ParameterError, naming ``name``, for anything else.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, np.floating, np.integer)):
        raise ParameterError(name, f"expected a number, got {reprlib.repr(value)}")
    try:
        result = float(value)
    except OverflowError as error:  # TOML has whole numbers of any length
        raise ParameterError(name, f"expected a number up to {LARGEST:g}, got {reprlib.repr(value)}") from error
    if not np.isfinite(result):
        raise ParameterError(name, f"must be finite, got {result}")
    if above is not None and not result > above:
        raise ParameterError(name, f"must be greater than {above:g}, got {result:g}")
    if at_least is not None and result < at_least:
        raise ParameterError(name, f"must not be less than {at_least:g}, got {result:g}")
    if at_most is not None and result > at_most:
        raise ParameterError(name, f"must not be more than {at_most:g}, got {result:g}")
    if result and not SMALLEST <= abs(result) <= LARGEST:
        raise ParameterError(name, f"expected a magnitude from {SMALLEST:g} to {LARGEST:g}, got {result:g}")
    return result


def check_whole(value: Any, name: str, **bounds: float | None) -> int:
    """A whole number within bounds, see :func:`check_number`, also given as 2.0.  Raises ParameterError as there."""
    if (number := check_number(value, name, **bounds)) != int(value):
        raise ParameterError(name, f"expected a whole number, got {number:g}")
    return int(value)


def check_inertia(value: Any, name: str) -> Array:
    """A symmetric positive definite inertia whose principal moments satisfy the triangle inequality."""
    array = freeze(value, (3, 3), name)
    if not np.allclose(array, array.T, rtol=0.0, atol=1e-9 * np.abs(array).max()):
        raise ParameterError(name, f"must be symmetric, got {array.tolist()}")
    moments = np.linalg.eigvalsh(array)
    if moments[0] < SMALLEST:
        raise ParameterError(name, f"must be positive definite; its principal moments are {moments.tolist()} kg.m2")
    if moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-9):
        raise ParameterError(
            name,
            f"no rigid body has the principal moments {moments.tolist()} kg.m2: "
            "the largest exceeds the sum of the others",
        )
    return array


def check_truth(value: Any, name: str) -> bool:
    """A truth value, also given as 0 or 1.  Raises ParameterError, naming ``name``, for anything else."""
    if value not in (False, True):
        raise ParameterError(name, f"expected true or false, got {reprlib.repr(value)}")
    return bool(value)


class Checked:
    """Base of the parameter classes: checks each :func:`quantity`, and stores it in its own type.

    Raises ParameterError, naming the field.
    """

    def __post_init__(self) -> None:
        for f in fields(self):  # type: ignore[arg-type]  # every subclass is a dataclass
            value, name = getattr(self, f.name), _public(f.name)
            if f.metadata.get("shape"):
                self._set(f.name, freeze(value, f.metadata["shape"], name))
            elif f.type == "float":
                self._set(f.name, check_number(value, name, **f.metadata["bounds"]))
            elif f.type == "int":
                self._set(f.name, check_whole(value, name, **f.metadata["bounds"]))
            elif f.type == "bool":
                self._set(f.name, check_truth(value, name))
            elif f.type == "str" and not isinstance(value, str):
                raise ParameterError(name, f"expected text, got {reprlib.repr(value)}")

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)


class Signal(NamedTuple):
    """A vector that a model puts out."""

    name: str
    components: tuple[str, ...]
    unit: str
    description: str
    nominal: float
    """Magnitude under the default disturbance, or in a slew."""
    display_unit: str | None = None
    starts_at_zero: bool = True
    """Zero at the start whatever the inputs are: the system begins at rest and undeformed."""

    @property
    def names(self) -> list[str]:
        """Names of the components: ``base_position.x``, ``fine_displacement_1``."""
        joint = "_" if self.components[0].isdigit() else "."
        return [f"{self.name}{joint}{component}" for component in self.components]


@dataclass(frozen=True)
class Entry:
    """One scalar of a parameter set."""

    name: str
    value: float | bool | int | str
    unit: str
    description: str
    minimum: float | None = None
    """Smallest value, or a bound that the value must be above."""
    maximum: float | None = None
    display: str | None = None
    """Unit to display it in."""


def list_entries(obj: Any, prefix: str = "", keep: Callable[[str], bool] | None = None) -> list[Entry]:
    """All scalars of a parameter dataclass, in the order of its fields.

    Parameters
    ----------
    obj: one of the dataclasses of :mod:`.parameters` (any nesting).
    prefix: put before every name, for example ``"payload"``.
    keep: only the names for which it is true.
    """
    found: list[Entry] = []
    for f in fields(obj):
        value, name = getattr(obj, f.name), _field_name(f, prefix)
        unit, text = f.metadata.get("unit", ""), f.metadata.get("description", "")
        if isinstance(value, np.ndarray):
            found += [
                Entry(
                    f"{name}.{suffix}",
                    float(value[index]),
                    _unit(unit, index, value.ndim),
                    f"{text} ({suffix})",
                    display=f.metadata.get("display"),
                )
                for suffix, index in _components(value)
            ]
        elif isinstance(value, float | bool | int | str):
            bounds, display = f.metadata["bounds"], f.metadata["display"]
            minimum = bounds["above"] if bounds["at_least"] is None else bounds["at_least"]
            found.append(Entry(name, value, unit, text, minimum, bounds["at_most"], display))
        else:
            within = f.metadata.get("keep")
            for inner, item in list_members(value, name):
                found += list_entries(item, inner, within)
    return found if keep is None else [e for e in found if keep(e.name)]


def list_members(value: Any, name: str) -> list[tuple[str, Any]]:
    """Prefix and value of each parameter dataclass in a field: one, a tuple of several, or a mapping of both."""
    if isinstance(value, tuple):
        return [(f"{_singular(name)}_{i}", item) for i, item in enumerate(value, 1)]
    if isinstance(value, Mapping):
        return [pair for key, item in value.items() for pair in list_members(item, _join(name, key))]
    return [(name, value)]


def replace_values(obj: T, values: Mapping[str, Any], prefix: str = "") -> T:
    """A copy of ``obj`` with some scalars replaced; the copy checks itself as any other.

    Raises
    ------
    ParameterError: a name does not exist, or a value is impossible; the text starts with the full name.
    """
    known = {e.name for e in list_entries(obj, prefix)}
    for name in values:
        if name not in known:
            raise ParameterError(name, "no such parameter")
    return _replaced(obj, values, prefix)


def take_values(obj: T, values: Mapping[str, Any], prefix: str = "") -> T:
    """As :func:`replace_values`, but for a mapping that also holds other things' values: they are passed over.

    Parts of which no value changes are not copied.
    """
    entries = [e for e in list_entries(obj, prefix) if e.name in values]
    changed = {e.name: values[e.name] for e in entries if not _is_same(values[e.name], e.value)}
    result: T = _replaced(obj, changed, prefix) if changed else obj
    return result


def _is_same(value: Any, other: Any) -> bool:
    return type(value) is type(other) and value == other and (value != 0.0 or str(value) == str(other))  # -0.0


def _replaced(obj: Any, values: Mapping[str, Any], prefix: str) -> Any:
    changes = {f.name: _replaced_value(getattr(obj, f.name), values, _field_name(f, prefix)) for f in fields(obj)}
    try:
        return replace(obj, **changes)
    except ParameterError as error:
        raise ParameterError(_join(prefix, error.name), error.problem) from None


def _replaced_value(value: Any, values: Mapping[str, Any], name: str) -> Any:
    if is_dataclass(value) and not any(f"{key}.".startswith(f"{name}." if name else "") for key in values):
        return value
    if is_dataclass(value):
        return _replaced(value, values, name)
    if isinstance(value, tuple):
        return tuple(_replaced(item, values, inner) for inner, item in list_members(value, name))
    if isinstance(value, Mapping):
        return {key: _replaced_value(item, values, _join(name, key)) for key, item in value.items()}
    if not isinstance(value, np.ndarray):
        return values.get(name, value)
    array = value.copy()
    for suffix, index in _components(value):
        array[index] = values.get(f"{name}.{suffix}", array[index])
        array[index[::-1]] = array[index]
    return array


def _components(value: Array) -> list[tuple[str, tuple[int, ...]]]:
    """(suffix, index) of each independent component of an array."""
    if value.ndim == 2:
        axes = AXES if value.shape[0] == 3 else WRENCH_AXES
        separator = "" if value.shape[0] == 3 else "_"
        n = value.shape[0]
        return [(f"{axes[i]}{separator}{axes[j]}", (i, j)) for i in range(n) for j in range(i, n)]
    names = {2: ("min", "max"), 3: AXES, 4: QUATERNION, 6: TWIST_AXES}[value.shape[0]]
    return [(suffix, (i,)) for i, suffix in enumerate(names)]


def _field_name(f: Field[Any], prefix: str) -> str:
    return prefix if f.metadata.get("flat") else _join(prefix, _public(f.name))


def _unit(unit: str, index: tuple[int, ...], ndim: int) -> str:
    """Mixed arrays list their units as ``translation|rotation`` (or ``force2|force.torque|torque2``)."""
    choices = unit.split("|")
    return choices[0] if len(choices) == 1 else choices[sum(i >= 3 for i in index)]


def _public(name: str) -> str:
    return name[:-2] if name.endswith(("_B", "_P")) else name


def _singular(name: str) -> str:
    return name.removesuffix("s")


def _join(prefix: str, name: str) -> str:
    return f"{prefix}.{name}" if prefix else name
