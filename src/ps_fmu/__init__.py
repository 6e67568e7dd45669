"""Pointing and stabilising manipulator for optical space payloads, as FMI 2.0 co-simulation FMUs."""

__version__ = "0.1.0"
