"""Finding a parameter set from the published numbers: one module for each step of ``ps-fmu identify``."""
