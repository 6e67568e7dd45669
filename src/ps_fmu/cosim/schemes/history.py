"""Inputs between two communication points: the lines that follow from the values so far, see ``native/lines.h``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from ctypes import Structure, addressof, c_double, c_int64, c_void_p

import numpy as np
from numpy.typing import NDArray

from ..checkpoint.state import State, copy_into
from ..plan import Change
from ..rows import Array


class _Lines(Structure):
    """``Lines`` of lines.h."""

    _fields_ = (
        *((name, c_int64) for name in ("count", "smoothed")),
        *((name, c_double) for name in ("start", "step", "length", "offset", "part")),
        *((name, c_void_p) for name in ("places", "held", "periods", "ahead", "values", "slopes")),
        *((name, c_void_p) for name in ("memory", "first", "begin", "slope")),
    )


class InputHistory:
    """Samples of some inputs of a component, and the line on which each of them goes through a step of the component.

    Parameters
    ----------
    times: start of the base steps, their length, that of the component's step [s]
    smoothed: lines begin where the last ones ended
    first: values (inputs,) where the first step begins
    periods: (inputs,), base steps between two values of the source
    ahead: (inputs,), 1 where the source has made the present base step already, else 0
    """

    def __init__(
        self, times: tuple[float, float, float], smoothed: bool, first: Array, periods: Sequence[int],
        ahead: Sequence[int],
    ) -> None:  # fmt: skip
        self._times, self._smoothed = times, smoothed
        self._periods, self._ahead = np.array(periods, dtype=np.int64), np.array(ahead, dtype=np.int64)
        n = len(first)
        # Rows: time and value of the last sample but one, of the last, and where the line of the last step ended.
        self._memory = np.full((5, n), np.nan)
        self._first = first.copy()
        self.begin: Array = np.zeros(n)
        """Where the lines begin."""
        self.slope: Array = np.zeros(n)
        """Their slopes [1/s]."""

    def copy_from(self, other: InputHistory) -> None:
        """Take over the samples of another history of the same inputs."""
        self._memory[:] = other._memory
        self._first[:] = other._first

    def save_state(self) -> dict[str, State]:
        """The samples, and the lines of the present step of the component."""
        return {name: array.copy() for name, array in self._list_state().items()}

    def load_state(self, state: Mapping[str, State]) -> None:
        """Take over samples and lines of the same inputs.  Raises ValueError or KeyError: no such."""
        for name, target in self._list_state().items():
            copy_into(target, state[name])

    def _list_state(self) -> dict[str, Array]:
        return {"memory": self._memory, "first": self._first, "begin": self.begin, "slope": self.slope}

    def extend(
        self, values: Array, places: NDArray[np.intp], held: NDArray[np.int64], offset: float, length: float,
        slopes: Array | None,
    ) -> Change:  # fmt: skip
        """What puts the lines into the inputs of a part of the component's step.

        ``values`` (inputs,) are all gathered Reals, ``places`` those among them that the history has; those that are
        ``held`` stay as they are.  The part begins ``offset`` after the step and is ``length`` long [s].  With
        ``slopes`` the FMU gets value and slope, else the mean.
        """
        arrays = places, held, self._periods, self._ahead, values, slopes
        own = self._memory, self._first, self.begin, self.slope
        addresses = [None if array is None else array.ctypes.data for array in (*arrays, *own)]
        lines = _Lines(len(self._first), int(self._smoothed), *self._times, offset, length, *addresses)
        return Change("extend", address=addressof(lines), keeps=(arrays, own, lines))
