"""FMUs that stay loaded from run to run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress

from ..cosim import CosimError, Master, System, Value
from ..cosim.structure import Parameter


class LoadedSystem:
    """A Master that is reset where another one would be made.

    Parameters
    ----------
    base: the system as its file has it; that of a run has other start values.
    """

    def __init__(self, base: System) -> None:
        self._base = base
        self._master: Master | None = None

    @contextmanager
    def open(self, structure: System, make: Callable[[System], Master]) -> Iterator[Master]:
        """The Master of ``structure`` before its initialisation, as :meth:`hold`."""
        with self.hold(_list_changes(self._base, structure), make) as master:
            yield master

    @contextmanager
    def hold(
        self, changes: Mapping[str, Value] | Mapping[str, Parameter], make: Callable[[System], Master]
    ) -> Iterator[Master]:
        """The Master of the base with other start values, before its initialisation; ``make`` makes one of the base.

        After an error the FMUs are freed, and loaded anew by the next run.  Raises :class:`..cosim.CosimError`.
        """
        try:
            if self._master is None:
                self._master = make(self._base)
            self._master.reset(changes)
            yield self._master
        except BaseException:
            with suppress(CosimError):  # the first error is the one that counts
                self.close()
            raise

    def close(self) -> None:
        """Free the FMUs; safe to call twice."""
        master, self._master = self._master, None
        if master is not None:
            master.close()


def _list_changes(base: System, structure: System) -> Mapping[str, Parameter]:
    """Start values of a system that are not those of the base."""
    return {
        f"{component.name}.{name}": entry
        for before, component in zip(base.components, structure.components, strict=True)
        for name, entry in component.parameters.items()
        if before.parameters.get(name) != entry
    }
