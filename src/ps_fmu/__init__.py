"""Pointing and stabilising manipulator for optical space payloads, as FMI 2.0 co-simulation FMUs.

``ps_fmu.simulate`` runs a scenario, ``ps_fmu.Result`` has what a run left in its folder, see
:mod:`ps_fmu.simulation`.
"""

__version__ = "0.1.0"
__all__ = ["Result", "__version__", "simulate"]


def __dir__() -> list[str]:
    """What there is, also what is imported only when it is first used."""
    return sorted({*globals(), *__all__})


def __getattr__(name: str):  # type: ignore[no-untyped-def]  # of what is asked for: its type is not known here
    """``simulate`` and ``Result``, imported when they are first used.

    Each part of the package, and each FMU, imports this file: it loads nothing by itself.
    """
    if name not in ("simulate", "Result"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.simulation"), name)
