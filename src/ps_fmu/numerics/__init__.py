"""Arithmetic on long arrays for the physics, compiled where this package has a library for the platform."""
