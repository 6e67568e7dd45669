"""The mechanism of the paper: parameters, kinematics, dynamics, control, disturbances.  Knows nothing of FMI."""
