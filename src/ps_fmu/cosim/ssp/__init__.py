"""Systems as files: SSP 1.0 and 2.0 are read, SSP 1.0 is written, and a single FMU is read as a system."""
