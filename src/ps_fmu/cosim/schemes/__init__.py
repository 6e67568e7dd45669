"""Schemes of the co-simulation: rates, extrapolated inputs, iterated loops, and estimates of the error."""
