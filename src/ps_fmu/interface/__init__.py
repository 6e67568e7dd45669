"""What the FMUs show of the physics: their parameters and start values."""
