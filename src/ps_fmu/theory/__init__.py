"""Closed forms of linear theory: transfer matrices, internal loop and margins, jitter; independent of FMI."""
