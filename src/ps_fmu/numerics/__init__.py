"""Compiled arithmetic: on long arrays for the physics, and the kernel that steps a slave in Python."""
