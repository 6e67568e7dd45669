"""Co-simulation of FMUs: read a system, run it, record it."""

from .errors import CosimError, RecorderError, SlaveError, SystemFileError, UsageError, WiringError
from .master import Event, Master
from .recording.delivery import Observer
from .recording.recorder import Recorder
from .rows import Column
from .ssp.reading import read_parameters, read_system
from .ssp.writing import write_ssp
from .structure import PortName, System, Value

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
