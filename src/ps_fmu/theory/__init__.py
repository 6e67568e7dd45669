"""Closed forms of linear theory: transfer matrices, internal loop and margins, jitter.  Knows nothing of FMI."""
