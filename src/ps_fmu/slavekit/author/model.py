"""What a model states about itself: sizes, variables, its linear map and its events.

This is the part of the base class that model authors read; :class:`ps_fmu.slavekit.author.slave.Slave` drives it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from pythonfmu.fmi2slave import Fmi2Slave

from .blocks import Matrices
from .buffer import Array
from .elements import Element
from .terminals import Terminal
from .variables import Port


class Model(Fmi2Slave):
    """A system that is linear between events::

        [y; x] <- step_map(h) @ [x; u; a]        each step, between its elements
        y       = output_map() @ [x; u; a]       in initialisation mode

    y are all outputs in the order of ``ports``, Booleans as 0 and 1 (declare them last: hosts then read the Reals in
    one piece); x the states; u the Real inputs that are not events; a auxiliary inputs that the model sets itself, for
    example the constant 1.  An output that an event computes is a component of ``a`` that the map copies.

    What a step or an event needs later lies in x, a or memory, or is rebuilt from them by :meth:`restore`.  All of it
    must stay finite.
    """

    ports: ClassVar[tuple[Port, ...]] = ()
    terminals: ClassVar[tuple[Terminal, ...]] = ()
    n_states: ClassVar[int] = 0
    """Size of x.  Fixed: a mode that is switched off keeps its place, with zeros."""
    provides_derivatives: ClassVar[bool] = False
    """True: hosts may ask for directional derivatives, by :meth:`linearise`; ``x[i]``, ``der(x[i])`` are variables."""
    n_auxiliary: ClassVar[int] = 0
    n_memory: ClassVar[int] = 0
    """Further numbers that events keep; part of the FMU state."""
    limit_flag: ClassVar[str] = ""
    """A Boolean output that a step makes true if it meets a limit, see :meth:`limits`; false is up to the map."""
    any_step: ClassVar[bool] = False
    """True: one map and one list of elements, of ``default_step``, serve steps of any size.

    What depends on the size is done by elements, which read it from the core.
    """

    model_description: ClassVar[str] = ""
    default_step: ClassVar[float] = 1e-4  # s
    default_stop: ClassVar[float] = 10.0  # s

    # Views of the buffer, never rebound.
    y: Array
    x: Array
    u: Array
    a: Array
    memory: Array

    def configure(self) -> None:
        """Build the model from parameters and present inputs; set x, a, memory and derived values.

        It is called in initialisation mode, and again after a value is set there: a second call must give the same
            result.

        Raises
        ------
        ModelError: a parameter or input is impossible; the message names it.
        """

    def output_map(self) -> Array | None:
        """Return the map from [x; u; a] to the outputs, (ny, nx + nu + na); None: ``configure`` sets y itself.

        May have fewer columns: the last operands are then not used.  By default, that of :meth:`continuous`.
        """
        matrices = self.continuous()
        return None if matrices is None else np.hstack(matrices[2:])

    def continuous(self) -> Matrices | None:
        """Return A, B, C, D of ``x' = A x + B [u; a]``, ``y = C x + D [u; a]``; None: ``step_map`` is used instead.

        Shapes (nx, nx), (nx, nu + na), (ny, nx), (ny, nu + na).  Inputs are held over a step, whose map is made without
        Python for whatever size the host asks for; the class then has ``any_step``.
        """
        return None

    def linearise(self) -> tuple[Matrices, Array]:
        """Return A, B, C, D of the present system about its present state, and the rates of its states (nx,).

        States x, inputs u, outputs y at the end of a short step with these inputs: shapes (nx, nx), (nx, nu), (ny, nx),
        (ny, nu).  NaN: this derivative is not provided.  It depends on the buffer alone.  By default, the parts of
        :meth:`continuous`, of a model in which no element passes u on.

        Raises
        ------
        ModelError: the system is not linear and continuous as it is, for example by a delay; the message names what
            makes it so.
        """
        matrices = self.continuous()
        assert matrices is not None
        (A, B, C, D), n = matrices, len(self.u)
        return (A, B[:, :n], C, D[:, :n]), A @ self.x + B @ np.concatenate([self.u, self.a])

    def step_map(self, h: float) -> Array | None:
        """Return the matrix of a step of size h, s, (ny + nx, nx + nu + na).  It is cached by h until ``remap()``.

        None: there is no map, elements do all.  May have fewer columns: the last operands are then not used.  An
        operand that is 0 costs nothing.
        """
        raise NotImplementedError(f"{type(self).__name__} has no step_map: define step_map(h), or continuous()")

    def before_map(self, h: float) -> Sequence[Element]:
        """Return the elements of a step of size h, s, before the map, in this order; see :mod:`.elements`.

        Asked together with ``step_map``.  It may read all of the buffer, such as y of the last step.
        What it writes to x, a and memory is there for the map.

        To compile a list takes 50 us.  Models whose map changes often give the same objects again.
        """
        return ()

    def after_map(self, h: float) -> Sequence[Element]:
        """Return the elements of a step of size h, s, after the map and before ``limits``."""
        return ()

    def event(self, t: float, h: float) -> bool:
        """Handle an event before the step from t to t + h, s: an event input changed, or an event is due.

        Returns True to be called again before the next step.  If it raises, the step is refused, everything
        in the buffer is as before, :meth:`restore` is called, and the event stays due.
        """
        return False

    def limits(self) -> tuple[Array, Array] | None:
        """Return lowest and highest values of y at the end of a step, each (ny,); -inf and inf: no limit.

        Results beyond them are held there.  Asked for with each new map; None: no limits at all.
        """
        return None

    def restore(self) -> None:
        """Rebuild what is derived (matrices, plans) from the buffer: an FMU state was set, or an event failed.

        Not called for a state that this instance gave after its last event: what is derived is that of the
        state then.
        ``configure`` may never have been called in this instance.  By default it is called now, which is right for
        models whose derived data depend on parameters alone.  What this does to the buffer is undone.
        """
        self.configure()
