"""What building an FMU raises; apart from the builder, so that who only names it need not import that."""

from __future__ import annotations


class BuildError(RuntimeError):
    """An FMU that cannot be built or wrapped; the text says which and why."""
