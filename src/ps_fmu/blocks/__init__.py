"""Passes over blocks of rows, compiled where there is a library for the platform, and the same to the bit in numpy."""
