"""``--disturbance FILE``: a recorded wrench on the bus, from a CSV or netCDF file, in place of the noise.

The disturbance source reads CSV.  A netCDF file is written again as CSV into the output folder.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..cosim import System, UsageError
from ..cosim.ssp.packing import find_values
from ..disturbance.recording import HEADER, MAX_ROWS, RecordingSettings, read_columns
from ..interface.system_model import PLANT, read_disturbance
from ..mechanism.dynamics import bus_mass, rigid_body_mass
from ..mechanism.linear_model import Plant
from ..mechanism.parameters import load
from ..mechanism.quantities import Array, ParameterError, take_values
from ..reduction.columns import NETCDF_LOCK
from ..results.style import engineering
from ..slavekit.author.units import parse_unit
from .options import CONVERTED, OptionError, RunOptions

_NETCDF = (b"CDF", b"\x89HDF")  # first bytes: classic, and netCDF-4
_TIMES = {"second": "s", "sec": "s", "millisecond": "ms", "minute": "min", "hour": "h"}


def provide_recording(options: RunOptions, path: Path) -> Path:
    """A recording as the CSV file that the disturbance source reads: ``path`` itself, or a copy in the output folder.

    Raises :class:`OptionError` for a file that cannot be used: with its name, and the line or variable.
    """
    try:
        with path.open("rb") as file:
            first = file.read(4)
        if first.startswith(_NETCDF):
            table = read_netcdf(path)
            read = options.output / CONVERTED
            np.savetxt(read, table, fmt="%.17g", delimiter=",", header=",".join(HEADER), comments="")
        else:
            table, read = read_columns(path, HEADER, ""), path
    except ParameterError as error:
        raise OptionError(f"--disturbance: {error.problem}") from error
    except OSError as error:
        raise OptionError(f"--disturbance: {path}: {error.strerror or error}") from error
    begin, end = table[0, 0], table[-1, 0]
    if begin >= options.duration_s or end <= 0.0:
        raise OptionError(
            f"--disturbance: {path} holds {begin:g} to {end:g} s, the run lasts from 0 to "
            f"{options.duration_s:g} s"
        )
    return read.absolute()


def explain_drift(system: System, component: str, duration_s: float) -> Iterator[str]:
    """What the recording of a disturbance source leaves behind in a run, a text for each thing: a drift, and a jump.

    The drift is that of the free spacecraft as one rigid body, bus and payload, from rest.  It is mentioned where it is
    larger than the motion that stays without it.  Raises :class:`ps_fmu.cosim.UsageError` for an unusable recording.
    """
    where = f"{component}.recording"
    try:
        settings = read_disturbance(system, component)
        own = settings.kinds["recording"]
        assert isinstance(own, RecordingSettings)
        recording = own.make_source(settings, 1)
    except ParameterError as error:
        name = error.name if error.name.startswith(component) else f"{where}.{error.name}"
        raise UsageError(f"{name}: {error.problem}") from error
    if recording is None:
        return
    file, (begin, end) = Path(own.path).name, recording.span
    plant = next((one for one in system.components if one.source.stem == PLANT), None)
    if plant is not None and not own.detrend:
        physics = take_values(Plant.from_parameters(load()), find_values(plant))
        payload, place_B = physics.payload, physics.manipulator.nominal_translation_B
        mass = bus_mass(physics.bus) + rigid_body_mass(payload.mass, place_B + payload.com_P, payload.inertia_P)
        left, steady = recording.integrate(duration_s), own.make_recording(settings, detrend=True)
        moved = np.linalg.solve(mass, left.second)
        swing = np.abs(np.linalg.solve(mass, steady.swing(duration_s).T)).max(axis=1)
        if (np.abs(moved) > swing).any():
            over = _describe(left.second / duration_s, "N.s", "N.m.s")
            last = _describe(left.first, "N.s", "N.m.s")
            yield (
                f"{where}: {file} gives the free spacecraft a mean momentum of {over} over {duration_s:g} s, and "
                f"{last} at the end: it drifts by {_describe(moved, 'm', 'rad')}, where all else moves it by up to "
                f"{_describe(swing, 'm', 'rad')}. "
                f"{where}.detrend = true takes the drift out"
            )
    if recording.repeats and duration_s > end and (np.abs(recording.jump) > 5.0 * recording.usual_jump).any():
        yield (
            f"{where}: {file} jumps by {_describe(recording.jump, 'N', 'N.m')} each time it begins again, every "
            f"{end - begin:g} s; {where}.overlap = 1 s, for example, fades its end into its beginning"
        )


def _describe(wrench: NDArray[np.floating], unit: str, of_torque: str) -> str:
    """The magnitudes of both parts of a vector (6,)."""
    texts = []
    for part, name in ((wrench[:3], unit), (wrench[3:], of_torque)):
        size = float(np.linalg.norm(part))
        factor, label = engineering(name, size)
        texts.append(f"{factor * size:.3g} {label}")
    return " and ".join(texts)


def read_netcdf(path: Path) -> Array:
    """Time, force and torque of a netCDF file in the columns of :data:`..recording.HEADER`, (rows, 7).

    Variables are ``time`` and, over it, ``force.x`` or ``force_x`` and so on, or ``force`` and ``torque`` with a second
    dimension of three, all also as ``base_force`` and ``base_torque``.  Each has its attribute ``units``.

    Raises
    ------
    ParameterError: the file cannot be used; the text names the variable.
    OSError: it cannot be read.
    """
    import netCDF4

    with NETCDF_LOCK, netCDF4.Dataset(path) as file:
        time = _read(path, file, ("time",), "s")
        if time.ndim != 1 or not 2 <= len(time) <= MAX_ROWS:
            raise _bad(path, "time", f"expected 2 to {MAX_ROWS} values, got the shape {time.shape}")
        columns = [time]
        for kind, unit in (("force", "N"), ("torque", "N.m")):
            both = kind, f"base_{kind}"
            if vector := next((name for name in both if name in file.variables), None):
                values = _read(path, file, (vector,), unit)
                if values.shape != (len(time), 3):
                    raise _bad(path, vector, f"expected the shape ({len(time)}, 3), got {values.shape}")
                columns += list(values.T)
                continue
            for axis in "xyz":
                names = tuple(f"{name}{joint}{axis}" for name in both for joint in "._")
                values = _read(path, file, names, unit)
                if values.shape != time.shape:
                    raise _bad(path, names[0], f"expected the shape {time.shape}, as of time, got {values.shape}")
                columns.append(values)
    late = np.flatnonzero(~(np.diff(time) > 0.0))
    if late.size:
        row = int(late[0]) + 1
        raise _bad(path, "time", f"{time[row]:g} s, its value {row + 1}, does not come after {time[row - 1]:g} s")
    return np.column_stack(columns)


def _read(path: Path, file: object, names: tuple[str, ...], unit: str) -> Array:
    """The first variable of these names that there is, in a unit."""
    variables = file.variables  # type: ignore[attr-defined]  # a netCDF4.Dataset, which is imported when it is needed
    found = next((name for name in names if name in variables), None)
    if found is None:
        known = ", ".join(variables) or "none"
        raise _bad(path, names[0], f"no such variable, nor {' or '.join(names[1:]) or 'another'}; there are: {known}")
    variable = variables[found]
    factor = _find_factor(path, found, getattr(variable, "units", None), unit)
    if variable.dtype is str or variable.dtype.kind not in "fiu":
        raise _bad(path, found, f"expected numbers, got {variable.dtype}")
    if variable.size > 3 * MAX_ROWS:
        raise _bad(path, found, f"{variable.size} values; at most {MAX_ROWS} rows are read")
    values = np.atleast_1d(np.ma.filled(np.ma.asarray(variable[...], dtype=float), np.nan) * factor)
    wrong = np.argwhere(~np.isfinite(values))
    if wrong.size:
        raise _bad(path, found, f"value {int(wrong[0][0]) + 1} is missing or not finite")
    return np.asarray(values, dtype=float)


def _find_factor(path: Path, name: str, units: object, wanted: str) -> float:
    if not isinstance(units, str) or not units.strip():
        raise _bad(path, name, f"has no attribute units; expected {wanted} or a unit that can be converted")
    text = units.strip()
    if wanted == "s":  # CF: seconds since 2000-01-01; the run begins at zero
        text = text.split(" since ")[0].strip()
        text = _TIMES.get(text.removesuffix("s"), text)
    unit, target = parse_unit(text.replace(" ", ".").replace("*", ".")), parse_unit(wanted)
    assert target is not None  # one of ours
    if unit is None or unit.offset or unit.exponents != target.exponents:
        raise _bad(path, name, f"cannot convert the units {units!r} to {wanted}")
    return unit.scale / target.scale


def _bad(path: Path, variable: str, problem: str) -> ParameterError:
    return ParameterError("", f"{path.name}, variable {variable!r}: {problem}")
