"""Finds the scenarios that packages declare; what they need is imported when they run."""

from __future__ import annotations

import pkgutil
from importlib import import_module
from types import ModuleType

from .options import Scenario


def find_scenarios(*packages: ModuleType) -> dict[str, Scenario]:
    """Scenarios by name, in the order of the packages, then by the names of their files.

    A module or package directly inside one of ``packages`` declares a scenario as ``SCENARIO``; one without it is
    passed over.  All are imported, so ``SCENARIO`` names what takes long to import by :func:`.late.import_and_call`.
    Raises ``ValueError`` if two scenarios have the same name.
    """
    scenarios: dict[str, Scenario] = {}
    for package in packages:
        for entry in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
            scenario = getattr(import_module(entry.name), "SCENARIO", None)
            if scenario is None:
                continue
            if scenario.name in scenarios:
                raise ValueError(f"{entry.name}: there is another scenario with the name {scenario.name!r}")
            scenarios[scenario.name] = scenario
    return scenarios
