"""Pointing-error analysis: streaming metrics and spectra, figures, reports."""
