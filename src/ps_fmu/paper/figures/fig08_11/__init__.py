"""Figs 8 and 11: from base motion to payload rotation."""
