"""The equation ``F(z) = z`` of a loop, for values z at its interface."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..checkpoint.state import State, copy_into
from ..errors import ConvergenceError, SlaveError
from ..fmu_instance import FmuInstance
from ..rows import Array
from ..structure import PortName
from ..values import Conversion
from ..wires import Wires
from .scheme import Iteration

_INCREMENT = 1e-4  # of the largest value so far: exact in linear loops, and near enough in others
_SMALLEST = 1e-6  # in units of the nominal value
_SLOW = 0.3  # an iteration that leaves more of the residual than this asks for a new Jacobian


@dataclass(frozen=True)
class Solution:
    """``passes``: how often F was asked for; ``residual``: the largest of F(z) - z, in units of its tolerance."""

    passes: int
    residual: float


class NotConverged(Exception):
    """``place`` in z of the largest residual; ``difference`` there; see also :class:`Solution`."""

    def __init__(self, place: int, difference: float, passes: int, residual: float, iteration: Iteration) -> None:
        super().__init__(f"residual {residual} after {passes} passes")
        self.place, self.difference, self.passes, self.residual = place, difference, passes, residual
        self._iteration = iteration

    def explain(self, where: str, members: Sequence[str], variables: Sequence[object], time: float) -> ConvergenceError:
        """The error for the user.  ``where``: of the loop and its time [s]; ``variables``: names of z."""
        variable, iteration = str(variables[self.place]), self._iteration
        return ConvergenceError(
            f"loop of {', '.join(members)}: not solved {where} t = {time:.9g} s: after {self.passes} passes "
            f"{variable}\n  still changes by {self.difference:.3g}, {self.residual:.3g} times the tolerance (relative "
            f"{iteration.relative:g}, absolute {iteration.absolute:g}).\n"
            "  Choose a smaller step, a larger tolerance or another solver.",
            members=members,
            time=time,
            variable=variable,
            residual=self.residual,
        )


class InterfaceSolver:
    """Solves the equation again and again, for slowly changing F; the interface Jacobian is kept in between.

    Parameters
    ----------
    iteration: method, tolerances and limit
    nominal: (n,), magnitudes for the absolute tolerance
    """

    def __init__(self, iteration: Iteration, nominal: Array) -> None:
        self._iteration = iteration
        self._floor = iteration.absolute * nominal
        self._largest = _SMALLEST * nominal
        self._jacobian: Array | None = None

    def save_state(self) -> dict[str, State]:
        """What the next solution begins with."""
        return {
            "largest": self._largest.copy(),
            "jacobian": None if self._jacobian is None else np.ascontiguousarray(self._jacobian).copy(),
        }

    def load_state(self, state: Mapping[str, State]) -> None:
        """Take over the state of a solver for the same values.  Raises ValueError or KeyError: no such."""
        copy_into(self._largest, state["largest"])
        jacobian: Array | None = None
        if state["jacobian"] is not None:
            jacobian = np.empty((len(self._largest), len(self._largest)))
            copy_into(jacobian, state["jacobian"])
        self._jacobian = jacobian

    def solve(self, evaluate: Callable[[Array], Array], z: Array, derive: Callable[[], Array | None]) -> Solution:
        """Find z, from a first guess; the last call of ``evaluate`` is that of the solution.

        ``derive()`` gives the Jacobian of F (n, n) at the last z, where that costs no evaluation, else None.  FMUs may
        give the derivatives at the end of a short step: where two changes by these do not suffice, differences follow.

        Raises :class:`NotConverged`.
        """
        iteration, largest = self._iteration, self._largest
        passes, before, fresh, derived = 1, np.inf, False, False
        found = evaluate(z)
        for count in range(iteration.limit + 1):
            residual = found - z
            size = self._floor + iteration.relative * np.maximum(np.abs(z), np.abs(found))
            scaled = np.abs(residual) / size
            norm = float(scaled.max(initial=0.0))
            if norm <= 1.0:
                return Solution(passes, norm)
            if count == iteration.limit or not np.isfinite(norm):
                self._jacobian = None
                place = int(np.argmax(np.where(np.isfinite(scaled), scaled, np.inf)))
                raise NotConverged(place, float(residual[place]), passes, norm, iteration)
            np.maximum(largest, np.maximum(np.abs(z), np.abs(found)), out=largest)
            if iteration.method == "fixed-point":
                z = found
                found = evaluate(z)
                passes += 1
                continue
            if self._jacobian is None or (norm > _SLOW * before and not fresh) or (derived and count == 2):
                exact = None if derived else derive()
                derived = exact is not None
                self._jacobian = self._difference(evaluate, z, found) if exact is None else exact - np.eye(len(z))
                passes += 0 if exact is not None else len(z)
                fresh = True
            else:
                fresh = False
            change = self._find_change(residual)
            z = z + change
            found = evaluate(z)
            passes += 1
            if iteration.method == "broyden":
                self._update(change, found - z - residual)
            before = norm
        raise AssertionError

    def _difference(self, evaluate: Callable[[Array], Array], z: Array, found: Array) -> Array:
        """The Jacobian of F(z) - z by differences."""
        jacobian = np.empty((len(z), len(z)))
        for k in range(len(z)):
            moved = z.copy()
            moved[k] += _INCREMENT * self._largest[k]
            step = moved[k] - z[k]
            jacobian[:, k] = (evaluate(moved) - found) / step
        return jacobian - np.eye(len(z))

    def _find_change(self, residual: Array) -> Array:
        """Newton's step; of a singular Jacobian the smallest."""
        assert self._jacobian is not None
        if len(residual) == 1 and self._jacobian[0, 0] != 0.0:  # 0.5 us instead of 6, the same bits
            return -residual / self._jacobian[0]
        try:
            return np.asarray(np.linalg.solve(self._jacobian, -residual), dtype=np.float64)
        except np.linalg.LinAlgError:
            return np.asarray(np.linalg.lstsq(self._jacobian, -residual)[0], dtype=np.float64)

    def _update(self, change: Array, difference: Array) -> None:
        """Broyden's formula: the smallest change of the Jacobian that explains the last step, in scaled variables."""
        assert self._jacobian is not None
        weights = change / self._largest**2
        length = float(weights @ change)
        if length > 0.0 and np.isfinite(difference).all():
            self._jacobian += np.outer(difference - self._jacobian @ change, weights / length)


# ---- the Jacobian by the derivatives of the FMUs --------------------------------------------------------------------


@dataclass(frozen=True)
class Link:
    """A component of a loop: its Real inputs from the loop with source and factor, and its outputs into it."""

    instance: FmuInstance
    inputs: tuple[tuple[str, PortName, float], ...]
    outputs: tuple[PortName, ...]


def make_links(
    members: Sequence[FmuInstance], ways: Mapping[PortName, PortName], outputs: Collection[PortName],
    conversions: Mapping[PortName, Conversion],
) -> list[Link]:  # fmt: skip
    """The links of a loop: its components, the sources of their Real inputs in it, and its Real outputs."""
    links = []
    for member in members:
        inputs = [
            (port.variable, source, conversions[port].factor if port in conversions else 1.0)
            for port, source in ways.items()
            if port.component == member.name
        ]
        links.append(Link(member, tuple(inputs), tuple(port for port in outputs if port.component == member.name)))
    return links


def list_links(members: Sequence[FmuInstance], wires: Wires) -> list[Link]:
    """The links of a loop, in the order of its components."""
    by_name = {member.name: member for member in members}
    used = [s for target, s in wires.sources.items() if target.component in by_name and s.component in by_name]
    outputs = [port for port in dict.fromkeys(used) if by_name[port.component].variables[port.variable].type == "Real"]
    ways = {
        port: wires.sources[port]
        for name in by_name
        for port in wires.inputs[name]
        if wires.sources[port] in used and by_name[name].variables[port.variable].type == "Real"
    }
    return make_links(members, ways, outputs, wires.conversions)


def derive(
    links: Sequence[Link], unknowns: Sequence[PortName], time: float, at_once: bool = False
) -> Array | None:
    """Derivatives of what comes out of a loop by the unknowns that go in, (n, n).

    ``at_once``: all components see the unknowns; else each sees what those before it put out.  None if an FMU refuses.
    """
    jacobian = np.zeros((len(unknowns), len(unknowns)))
    try:
        for column, unknown in enumerate(unknowns):
            seen = {unknown: 1.0}
            found: dict[PortName, float] = {}
            for link in links:
                seeds = {name: factor * seen.get(source, 0.0) for name, source, factor in link.inputs}
                if not seeds or not link.outputs:
                    continue
                names = [port.variable for port in link.outputs]
                answer = link.instance.get_directional_derivative(names, seeds, time)
                found |= dict(zip(link.outputs, answer, strict=True))
                if not at_once:
                    seen |= found
            jacobian[:, column] = [found.get(port, 0.0) for port in unknowns]
    except SlaveError:
        if any(link.instance.has_failed for link in links):
            raise
        return None
    return jacobian if np.isfinite(jacobian).all() else None
