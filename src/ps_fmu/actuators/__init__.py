"""Actuators between the forces that a controller demands and those that act: voice coils, their drivers, the stops."""
