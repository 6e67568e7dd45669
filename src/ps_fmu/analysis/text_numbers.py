"""Numbers that the paper's text gives beside its tables: settings, claimed reach, what it says of Figs 8 and 11."""

from __future__ import annotations

import numpy as np

from ..manipulator.commander import DEFAULT_ALGORITHM_1
from ..manipulator.parameters import Array, load
from ..manipulator.stability import loop_at
from ..manipulator.workspace import STEP
from ..scenarios.support_modules import CASES, parameters_of
from ..scenarios.table2 import ORIENTATIONS
from . import transmissibility, workspace
from .command import Options
from .result import Finding
from .transmissibility import Curves, curves


def settings(options: Options) -> list[Finding]:
    """The parameters that sections 2.3 to 4.2 state, as equations and FMUs have them.

    Raises OSError without the parameter files of the system.
    """
    from ..cosim.parameters import read_parameters

    folder = options.system.parent / "parameters"
    damping = read_parameters(folder / "large_damping.ssv")["plant.fine_leg_1.damping"]
    delay = read_parameters(folder / "delay_20ms.ssv")["isolator.delay"]
    p, lighter = load(bus="OSM"), load(bus="LSM")
    controller = loop_at(p).controller
    integrators = controller.n_states - 3 * controller.lowpass.order  # the high-pass is in them: those of six axes
    turned = {axis: ORIENTATIONS[axis][i] for i, axis in enumerate(workspace.ANGLES)}
    values = {
        "epsilon": DEFAULT_ALGORITHM_1.epsilon,
        "workspace_step": 1e3 * STEP,  # mm
        "OSM_mass": p.bus.mass,
        "LSM_mass": lighter.bus.mass,
        "payload_mass": p.payload.mass,
        "fine_damping": p.manipulator.fine_legs[0].damping,
        "fine_damping_large": float(damping),
        "delay": float(delay),
        "lowpass_order": float(controller.lowpass.order),
        "lowpass_stop": p.filters.lowpass_stop_frequency,
        "highpass_order": integrators / 6,
        "highpass_corner": p.filters.highpass_frequency,
        "noise_from": float(p.noise.band[0]),
        "noise_to": float(p.noise.band[1]),
        **{f"orientation_{axis}": angle for axis, angle in turned.items()},
    }
    return [Finding(f"text.{name}", computed=value, setting=True) for name, value in values.items()]


def results() -> list[Finding]:
    """What the text claims of the results; 3 s."""
    return [
        any_orientation(),
        *amplification({name: curves(load(), rpy) for name, rpy in ORIENTATIONS.items()}),
        *cases({case: curves(parameters_of(case)) for case in CASES}),
    ]


def any_orientation() -> Finding:
    """The conclusions' range of arbitrary orientations."""
    return Finding(
        "text.any_orientation",
        workspace.compute().cube,
        remark="largest cube of roll, pitch and yaw that is all within reach",
    )


def amplification(at_orientations: dict[str, Curves]) -> list[Finding]:
    """The band that the isolator amplifies, and what becomes of the smaller singular values there.

    Those fall to anti-resonances of the passive plant, where any force is an amplification.
    """
    bands = np.array([_amplified(c) for c in at_orientations.values()])
    low, high = transmissibility.AMPLIFIED_BAND
    within = (low <= transmissibility.FREQUENCY) & (high >= transmissibility.FREQUENCY)
    second, third = np.max([(c.active - c.passive)[within].max(axis=0) for c in at_orientations.values()], axis=0)[1:]
    nominal = at_orientations["nominal"].amplification
    return [
        Finding(
            "fig8.amplification",
            remark=f"at (0, 0, 0) {nominal:.2f} dB; largest singular value: the second and the third are amplified by "
            f"up to {second:.1f} and {third:.1f} dB, at minima of the passive curves",
        ),
        Finding("fig8.amplified_from", float(bands[:, 0].min()), remark="largest singular value, lowest of the four"),
        Finding("fig8.amplified_to", float(bands[:, 1].max()), remark="largest singular value, highest of the four"),
    ]


def cases(of_cases: dict[str, Curves]) -> list[Finding]:
    """What the text says of Fig 11."""
    passive = {case: c.passive for case, c in of_cases.items()}
    gain = passive["LDOSM"][:, 0] - passive["OSM"][:, 0]
    most = int(gain.argmin())
    before, after = (passive[case][most, 0] for case in ("OSM", "LDOSM"))
    return [
        Finding("fig11.similar", _apart(passive["OSM"], passive["LSM"]), remark="of any singular value"),
        Finding("fig11.similar_damped", _apart(passive["LDOSM"], passive["LDLSM"]), remark="of any singular value"),
        Finding(
            "fig11.attenuation",
            float(transmissibility.FREQUENCY[most]),
            remark=f"from {before:.1f} to {after:.1f} dB; the largest values of the two curves are "
            f"{_peak(passive['OSM']):.1f} and {_peak(passive['LDOSM']):.1f} dB",
        ),
    ]


def _amplified(c: Curves) -> tuple[float, float]:
    """Ends of the band around the largest amplification in which the largest singular value is amplified, Hz."""
    frequency, low = transmissibility.FREQUENCY, transmissibility.AMPLIFIED_BAND[0]
    top = int(np.where(frequency >= low, c.gain, -np.inf).argmax())
    quiet = np.flatnonzero(c.gain <= 0.0)
    return float(frequency[quiet[quiet < top].max()]), float(frequency[quiet[quiet > top].min()])


def _apart(one: Array, other: Array) -> float:
    return float(np.abs(one - other).max())


def _peak(curve: Array) -> float:
    return float(curve[transmissibility.FREQUENCY < transmissibility.SUSPENSION_BELOW, 0].max())
