"""Pointing and stabilising manipulator for optical space payloads, as FMI 2.0 co-simulation FMUs.

``ps_fmu.simulate`` runs a scenario, ``ps_fmu.Session`` runs it many times, ``ps_fmu.Result`` contains the results of a
run.  ``ps_fmu.linearise`` makes a linear system of FMUs.  They raise the following errors, which
``ps_fmu`` exports, too.

========================  ==============================================================================================
error                     raised when
========================  ==============================================================================================
``OptionError``           an argument cannot be used: a name, a time, a file; the message names the option
``BuildError``            an FMU cannot be built from its sources
``CosimError``            a system cannot be read or run; each of the errors below is one
``UsageError``            a name or value does not suit the system: a component, a variable, a start value
``SystemFileError``       a file is refused, with file and line: a system, an FMU, start values, faults
``WiringError``           the parts of a system do not fit together; ``problems`` lists all reasons
``SlaveError``            an FMU refuses a call or gives a number that is not finite; ``component``, ``time``
``Divergence``            the motion has grown without limit: an unstable loop
``ConvergenceError``      a loop of FMUs is iterated and does not converge
``CheckpointError``       a checkpoint is damaged, or is of another system
========================  ==============================================================================================

Errors of other functions: ``ParameterError`` for an impossible value of the physics, ``RequirementError`` for a file of
requirements, ``StudyError`` for a study, ``UnstableError`` for a response of an unstable loop.
"""

__version__ = "0.1.0"
_PLACES = {
    "simulate": "simulation",
    "Session": "simulation",
    "linearise": "simulation",
    "Result": "result",
    "OptionError": "runs.options",
    "BuildError": "slavekit.pack.errors",
    "CosimError": "cosim.errors",
    "UsageError": "cosim.errors",
    "SystemFileError": "cosim.errors",
    "WiringError": "cosim.errors",
    "SlaveError": "cosim.errors",
    "ConvergenceError": "cosim.errors",
    "Divergence": "runs.divergence",
    "CheckpointError": "cosim.checkpoint.state",
    "ParameterError": "mechanism.quantities",
    "RequirementError": "requirements.requirement",
    "StudyError": "studies.study",
    "UnstableError": "theory.stability",
}
"""Modules of what is imported when it is first used: each part of the package, and each FMU, imports this file."""
__all__ = ["__version__", *_PLACES]


def __dir__() -> list[str]:
    """What there is, also what is imported only when it is first used."""
    return sorted({*globals(), *__all__})


def __getattr__(name: str):  # type: ignore[no-untyped-def]  # of what is asked for: its type is not known here
    """An object of another module, imported when it is first used."""
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
