"""Checkpoints: all that a run needs to go on where it was, in files that a kill at any moment leaves whole."""
