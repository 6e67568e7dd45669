"""The warnings of a run: on the terminal at once, and kept for summary.json and the report."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager


class WarningLog:
    """Warnings in the order in which they came, each text once; ``shown`` on the error stream, too."""

    def __init__(self, *, shown: bool = True) -> None:
        self._shown = shown
        self._texts: dict[str, None] = {}

    @property
    def texts(self) -> tuple[str, ...]:
        """All warnings so far."""
        return tuple(self._texts)

    def add(self, text: str) -> None:
        """Keep a warning and show it above a progress bar; nothing if it is known already."""
        from tqdm import tqdm

        if text not in self._texts:
            self._texts[text] = None
            if self._shown:
                tqdm.write(text, file=sys.stderr)

    @contextmanager
    def collect(self) -> Iterator[None]:
        """Add what the co-simulation logs as a warning during the body."""
        handler = logging.Handler(logging.WARNING)
        handler.emit = lambda record: self.add(record.getMessage())  # type: ignore[method-assign]
        logger = logging.getLogger("ps_fmu.cosim")
        logger.addHandler(handler)
        try:
            yield
        finally:
            logger.removeHandler(handler)
