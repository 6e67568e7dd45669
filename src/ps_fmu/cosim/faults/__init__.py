"""Faults of signals and parameters at given times, from a file: read, checked against the wiring, made to act."""
