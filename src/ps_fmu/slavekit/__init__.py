"""From a Python slave to an FMI 2.0 co-simulation FMU that loads anywhere.  Knows no other room."""
