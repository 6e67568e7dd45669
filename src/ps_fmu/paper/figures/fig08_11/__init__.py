"""Figs 8 and 11: transmissibility."""
