"""The figures and tables of the paper: each package or file here is one, found by its name ANALYSIS."""
