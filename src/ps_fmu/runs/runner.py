"""The one place that makes Masters: a system of FMUs, loaded, run once, or kept from run to run."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any, TypeVar

from ..cosim import Column, CosimError, Master, Observer, System, Value
from ..cosim.structure import Parameter

O = TypeVar("O", bound=Observer)  # noqa: E741  # an observer


def compute(
    system: System,
    step_s: float,
    duration_s: float,
    watch: Callable[[Sequence[Column]], O],
    *,
    only: Collection[str] | None = None,
) -> O:
    """Run a system from its start for ``duration_s``, by steps of ``step_s``; what has watched it.

    ``watch`` makes the observer once the columns are known; ``only``: names of those that are read.  Raises
    :class:`..cosim.CosimError`.
    """
    with Runner(system).open(system, step=step_s, only=only) as master:
        master.initialise()
        watching = watch(master.columns)
        master.run(duration_s, [watching])
    return watching


class Runner:
    """A Master that is reset where another one would be made.

    Parameters
    ----------
    base: the system as its file has it; that of a run has other start values.
    stays: the FMUs stay loaded from run to run, until :meth:`close`
    """

    def __init__(self, base: System, *, stays: bool = False) -> None:
        self._base, self._stays = base, stays
        self._master: Master | None = None
        self._how: Mapping[str, Any] = {}

    @contextmanager
    def open(self, structure: System, **how: Any) -> Iterator[Master]:
        """The Master of ``structure`` before its initialisation, as :meth:`hold`."""
        if self._stays:
            with self.hold(_list_changes(self._base, structure), **how) as master:
                yield master
            return
        with Master(structure, **how) as master:
            yield master

    @contextmanager
    def hold(self, changes: Mapping[str, Value] | Mapping[str, Parameter], **how: Any) -> Iterator[Master]:
        """The Master of the base with other start values, before its initialisation.

        ``how``: arguments of :class:`..cosim.Master`.  Where they are other ones than before, and after an error, the
        FMUs are loaded anew.  Raises :class:`..cosim.CosimError`.
        """
        try:
            if self._master is not None and any(self._how.get(name) != how[name] for name in how):
                self.close()
            if self._master is None:
                self._master, self._how = Master(self._base, **how), how
            self._master.reset(changes)
            yield self._master
        except BaseException:
            with suppress(CosimError):  # the first error is the one that counts
                self.close()
            raise

    @property
    def is_loaded(self) -> bool:
        """Whether the next run finds the FMUs loaded."""
        return self._master is not None

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
