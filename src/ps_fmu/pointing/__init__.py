"""Pointing errors as numbers: indices, spectra, responses.  Needs numpy and scipy, and no other room."""
