"""Reduction of recorded rows: to fewer rows by a low-pass, to counts by a histogram.

Compiled where there is a library for the platform, and the same to the bit in numpy.
"""
