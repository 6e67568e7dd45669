"""A row: what a study keeps of a case."""

from __future__ import annotations

from typing import Any

Row = dict[str, Any]
"""``case``, ``status``, ``error``, ``warnings``, ``wall_s``, ``worker``, and the metrics by name."""

DONE, FAILED, KILLED, LATE = "done", "failed", "killed its process", "took too long"
"""Values of ``status``."""
TEXTS = ("status", "error", "warnings", "worker")
OWN = ("case", *TEXTS, "wall_s")
"""Columns of each row, beside the metrics."""
MEASURED = ("wall_s", "worker")
"""Columns that another run of the same case has otherwise."""
VERDICT = "verdict/"
"""Beginning of the name of a column of a requirement."""
ANSWER = "/answer"
"""End of the name of a column with an answer on a requirement."""
HISTOGRAM = "/histogram"
"""End of the name of a column with the histogram of a run, for a requirement that is judged over all cases."""
LONGEST_TEXT = 2000  # of an error or of warnings


class VersionError(ValueError):
    """A worker has other releases of the packages that a row depends on."""


class StartError(RuntimeError):
    """The process for the cases did not get ready; the text has what it printed."""


class ClusterError(RuntimeError):
    """The cluster is lost, or cannot be had; the parts so far are kept."""
