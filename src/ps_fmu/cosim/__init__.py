"""Co-simulation of FMUs: read a system, run it, record it."""

from .clock import Event
from .errors import ConvergenceError, CosimError, RecorderError, SlaveError, SystemFileError, UsageError, WiringError
from .master import Master
from .recording.delivery import Observer
from .recording.recorder import Recorder
from .rows import Column
from .schemes.scheme import Iteration, Rate, Scheme
from .ssp.reading import read_parameters, read_system
from .ssp.writing import write_ssp
from .structure import PortName, System
from .values import Value

__all__ = [
    "Column",
    "ConvergenceError",
    "CosimError",
    "Event",
    "Iteration",
    "Master",
    "Observer",
    "PortName",
    "Rate",
    "Recorder",
    "RecorderError",
    "Scheme",
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
