"""Fig 7: trajectories of the platform."""
