"""Sensors: what instruments make of the true motion, with their noise and their limits."""
