"""Control of the manipulator: feedforward isolator, pointing commander, motion profile.  Knows nothing of FMI."""
