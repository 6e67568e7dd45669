"""Closed forms of linear theory: frequency responses, control loop and margins, jitter.  Knows nothing of FMI."""
