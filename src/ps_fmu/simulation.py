"""A scenario in a few lines of Python, for notebooks and scripts: ``simulate``, ``Session``, ``linearise``."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self, Unpack

import numpy as np

from .cosim.structure import Value
from .result import Result, read_folder, write_values
from .runs.options import PARAMETERS, GivenOptions, OptionError, claim_folder, make_options
from .runs.output import hold_folder, leave_no_empty_folder
from .runs.run import Run, SharedSystem, build_fmus, execute, find
from .runs.runner import Runner

if TYPE_CHECKING:
    from control import StateSpace


def simulate(
    scenario: str = "isolation",
    *,
    parameters: Mapping[str, Value] | None = None,
    cases: Sequence[str] = (),
    output: str | PathLike[str] | None = None,
    resume: bool = False,
    **options: Unpack[GivenOptions],
) -> Result:
    """Run a scenario or a system, and return its results.

    >>> import ps_fmu
    >>> result = ps_fmu.simulate("isolation", duration=20, parameters={"plant.payload.mass": 60.0})  # doctest: +SKIP
    >>> result.passive["payload_rotation"].sel(axis="x").std()  # doctest: +SKIP

    The rows stay in memory.  :meth:`Result.report` writes files and draws figures.  A requirement that is not met
    raises nothing.  A :class:`Session` runs a scenario many times with other parameters.  Threads may simulate at the
    same time.

    Parameters
    ----------
    scenario: a scenario that ``ps-fmu run --help`` lists, or any system: an ``.ssp``, ``.ssd``, ``.xml`` or ``.fmu``.
    parameters: start values by ``component.parameter``, in the units of ``ps-fmu list``; they override
        ``parameter_files`` and ``instrument``.
    seed: seed of the disturbance, 1 by default.
    cases: names of the cases to run, by default all; for scenarios that compare two cases.
    output: folder for the results, which are written during the run, as by ``ps-fmu run --no-figures``; for long runs.
    checkpoint: simulated time between two checkpoints, s.  They are written into the folder ``checkpoint`` of
        ``output``; a checkpoint is skipped if checkpoints would take more than 2 % of the time.
    resume: continue the run in ``output`` from its last checkpoint; all other arguments must be the same.
    source: a checkpoint, or the folder of a run that has checkpoints; the run begins in its state.
    anew: components that begin in their initial state then, so that their fixed parameters may differ.
    duration, step, storage_step: simulated time, communication step and time between stored rows, s; by default the
        values of the scenario.
    instrument: the TOML file of your instrument, see docs/instrument.md; all FMUs start with its values.
    parameter_files: ``.ssv`` files: paths, or names of files of ps_fmu; later files override earlier ones.
    apart: beginnings of names of parameters that differ deliberately from the plant's; they cause no warning.
    disturbance: a CSV or netCDF file with force and torque on the bus, which replace the noise.
    system: a system in place of the scenario's: the path of an ``.ssd`` file, the name of a file of ps_fmu, or an
        ``.ssp`` archive, which contains its FMUs.
    replace: FMUs in place of components, by their names: ``{"isolator": "my.fmu"}``, see docs/own-fmu.md.
    scheme: order of exchange, ``"jacobi"``, ``"gauss-seidel"`` or ``"iterated"``, see docs/any-system.md.
    observe: a pattern such as ``plant.payload_*``, or several patterns, of the outputs to store; by default all.
    requirements: a TOML file; the verdicts are in ``summary["verdicts"]``.
    inputs: a CSV file of inputs over time, see docs/any-system.md.
    faults: a file of faults, JSON or YAML, see docs/faults.md; ``summary["faults"]`` lists the faults that acted.
    isolate: True: each FMU runs in a process of its own; or the names of the components that do.  An FMU that crashes
        or hangs then ends the run with a message, and this process continues.
    step_timeout: seconds that a call of an isolated FMU in a step may take, by default 60.
    progress: show a progress bar on the error stream; by default it is shown.

    Raises
    ------
    OptionError: an argument cannot be used; the message names it as on the command line.
    BuildError, CosimError, OSError, ValueError: the FMUs cannot be built or run, or results cannot be written.
    """
    keeps = options.get("checkpoint") is not None
    if resume and (output is None or not keeps):
        raise OptionError("resume: expected the output folder of the run, and the time between checkpoints")
    options.setdefault("progress", True)
    if output is None:
        with Session(scenario, **options) as session:
            return session.run(parameters, cases=cases)
    if cases:
        raise OptionError("cases: a run with an output folder has all cases of the scenario")
    folder = read_folder(output)
    shown: list[str] = []
    with leave_no_empty_folder(folder), hold_folder(claim_folder(folder), resume):
        chosen = make_options(scenario, folder, **options)
        if parameters:
            path = folder / PARAMETERS
            write_values(path, _check_values(parameters), resume)
            chosen = dataclasses.replace(chosen, parameters=(*chosen.parameters, path))
        chosen = dataclasses.replace(chosen, resume=resume, figures=False)
        build_fmus(chosen)
        done = execute(chosen, shown.append)
    return Result(folder, "\n".join([*shown, *([done.refused] if done.refused else [])]))


def linearise(
    what: str = "isolation",
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    at: float = 0.0,
    constant: Sequence[str] = (),
    parameters: Mapping[str, Value] | None = None,
    parameter_files: Sequence[str | PathLike[str]] = (),
    instrument: str | PathLike[str] | None = None,
    system: str | PathLike[str] | None = None,
    replace: Mapping[str, str | PathLike[str]] | None = None,
    step: float | None = None,
) -> StateSpace:
    """The linear continuous system that a system of FMUs is about its state at a time, for python-control.

    Names in it have underscores for dots: ``plant_base_torque_x``.

    >>> plant = ps_fmu.linearise("isolation", inputs=["plant.base_torque.x"],
    ...     outputs=["plant.payload_rotation.x"])  # doctest: +SKIP

    It is made of the directional derivatives of the FMUs, which FMUs of any maker may provide.  Connections act at
    once, without the delay of an exchange.  Deviations from the present values are its states, inputs and outputs.
    Inputs by which an FMU provides no derivative, such as commands whose rate is limited, are taken as constant.

    Parameters
    ----------
    what: a scenario, whose system is taken as its files state it, or any system.
    inputs: Real inputs ``component.variable``; of a connected one, what is added to its signal.
    outputs: Real outputs ``component.variable``.
    at: simulated time at which it is linearised, s; the system runs up to it.
    constant: components whose outputs are taken as constant, for example a sampled sensor.
    parameters: start values by ``component.parameter``.
    parameter_files, instrument, system, replace, step: as of :func:`simulate`.

    Raises
    ------
    UsageError: a name is unknown, or a component is not linear and continuous, for example by a delay or a sample time.
    OptionError, CosimError: the system cannot be run up to the time.
    """
    from control import StateSpace as Made

    from .cosim.linearisation import linearise as linearise_system

    with tempfile.TemporaryDirectory(prefix="ps_fmu_") as folder:
        chosen = make_options(
            what, Path(folder), progress=False, parameter_files=parameter_files, instrument=instrument, system=system,
            replace=replace or {}, step=step,
        )  # fmt: skip
        chosen = dataclasses.replace(chosen, values=_check_values(parameters or {}))
        build_fmus(chosen)
        run = Run(chosen)
        loaded = run.load().structure
        with Runner(loaded).open(loaded, step=run.options.step_s) as master:
            master.initialise()
            if at:
                master.run(at)
            found = linearise_system(master, inputs, outputs, constant)
    names = {
        kind: [name.replace(".", "_") for name in getattr(found, kind)] for kind in ("states", "inputs", "outputs")
    }
    return Made(found.A, found.B, found.C, found.D, name=chosen.system.stem.replace(".", "_"), **names)


class Session:
    """Run a scenario many times with other parameters; its FMUs stay loaded.

    >>> with ps_fmu.Session("isolation", duration=5) as session:  # doctest: +SKIP
    ...     for delay in (0.0, 1e-3, 2e-3):
    ...         print(session.run(parameters={"isolator.delay": delay}).summary["rejection_percent"])

    The options are the arguments of :func:`simulate`; a progress bar is not shown by default.  Only one thread at a
    time may use a session.  Several sessions may run at the same time.

    Raises
    ------
    OptionError: an option cannot be used; the message names it as on the command line.
    BuildError, CosimError, OSError: the FMUs cannot be built, or the system cannot be read.
    """

    def __init__(self, scenario: str = "isolation", **options: Unpack[GivenOptions]) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="ps_fmu_")  # some scenarios hand a file to an FMU
        try:
            options.setdefault("progress", False)
            if options.get("checkpoint") is not None:
                raise OptionError("checkpoint: expected an output folder, too: checkpoints lie there")
            self.options = make_options(scenario, Path(self._folder.name), **options)
            build_fmus(self.options)
            self._shared = SharedSystem(self.options)
        except BaseException:
            self._folder.cleanup()
            raise

    def run(
        self, parameters: Mapping[str, Value] | None = None, *, seed: int | None = None, cases: Sequence[str] = ()
    ) -> Result:
        """Run the scenario; the results have the same bits as a run in a process of its own.

        Parameters
        ----------
        parameters: start values by ``component.parameter``.
        seed: seed of the disturbance.
        cases: names of the cases to run, by default all.

        Raises the errors of :func:`simulate`.
        """
        seed = self.options.seed if seed is None else seed
        options = dataclasses.replace(self.options, seed=seed, values=_check_values(parameters or {}))
        run = Run(options, tuple(cases), self._shared)
        return Result(None, found=(run, find(run)))

    def get_start(self, name: str) -> Value:
        """Return the start value of ``component.variable`` for a :meth:`run` without parameters.

        Raises :class:`ps_fmu.cosim.UsageError` if the variable does not exist.
        """
        return Run(self.options, (), self._shared).load().get_start(name)

    def close(self) -> None:
        """Free the FMUs; a second call does nothing."""
        self._shared.close()
        self._folder.cleanup()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _check_values(values: Mapping[str, Value]) -> dict[str, Value]:
    """The values, numpy's scalars as Python's.  Raises OptionError for a value of another type."""
    plain = {name: value.item() if isinstance(value, np.generic) else value for name, value in values.items()}
    for name, value in plain.items():
        if type(value) not in (bool, int, float, str):
            raise OptionError(f"parameters: {name}: expected a number, a Boolean or a text, got {value!r}")
    return plain
