"""Parameters and start values of the FMUs, and the linear model of a system."""
