"""From a Python class to an FMI 2.0 co-simulation FMU: base class, description, state, build."""
