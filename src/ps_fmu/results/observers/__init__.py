"""Streaming observers: they see a run block by block and keep only what their result needs."""
