"""Reduction of recorded rows: to fewer rows by a low-pass, to counts by a histogram.  All of it is compiled."""
