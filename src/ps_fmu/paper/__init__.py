"""What the paper publishes: numbers to compare with."""

from .published import Published, published

__all__ = ["Published", "published"]
