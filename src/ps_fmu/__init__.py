"""Pointing and stabilising manipulator for optical space payloads, as FMI 2.0 co-simulation FMUs.

``ps_fmu.simulate`` runs a scenario, ``ps_fmu.Session`` runs it many times, ``ps_fmu.Result`` has what a run found, or
left in its folder.
"""

__version__ = "0.1.0"
__all__ = ["Result", "Session", "__version__", "simulate"]


def __dir__() -> list[str]:
    """What there is, also what is imported only when it is first used."""
    return sorted({*globals(), *__all__})


def __getattr__(name: str):  # type: ignore[no-untyped-def]  # of what is asked for: its type is not known here
    """``simulate``, ``Session`` and ``Result``, imported when they are first used.

    Each part of the package, and each FMU, imports this file: it loads nothing by itself.
    """
    modules = {"simulate": "simulation", "Session": "simulation", "Result": "result"}
    if name not in modules:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{modules[name]}"), name)
