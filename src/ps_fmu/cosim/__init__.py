"""Co-simulation of FMUs: read a system, run it, record it."""

from .delivery import Observer
from .errors import CosimError, RecorderError, SlaveError, SystemFileError, UsageError, WiringError
from .master import Event, Master
from .recorder import Recorder
from .rows import Column
from .ssp import write_ssp
from .structure import PortName, System, Value
from .system import read_parameters, read_system

__all__ = [
    "Column",
    "CosimError",
    "Event",
    "Master",
    "Observer",
    "PortName",
    "Recorder",
    "RecorderError",
    "SlaveError",
    "System",
    "SystemFileError",
    "UsageError",
    "Value",
    "WiringError",
    "read_parameters",
    "read_system",
    "write_ssp",
]
