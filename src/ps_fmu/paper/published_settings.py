"""The settings that the paper publishes, as equations and FMUs have them."""

from __future__ import annotations

from ..control.commander import DEFAULT_ALGORITHM_1
from ..cosim.ssp.ssv import read_parameters
from ..mechanism.parameters import load
from ..mechanism.workspace import STEP
from ..theory.loop import loop_at
from .analysis import AnalysisOptions
from .figures.table2.closed_form import ORIENTATIONS
from .finding import Finding
from .published import ANGLES


def findings(options: AnalysisOptions) -> list[Finding]:
    """A finding for each setting.

    Raises
    ------
    OSError: a parameter file of the system is missing.
    """
    folder = options.system.parent / "parameters"
    damping = read_parameters(folder / "large_damping.ssv")["plant.fine_leg_1.damping"]
    delay = read_parameters(folder / "delay_20ms.ssv")["isolator.delay"]
    p, lighter = load(bus="OSM"), load(bus="LSM")
    controller = loop_at(p).controller
    integrators = controller.n_states - 3 * controller.lowpass.order  # the high-pass is in them: those of six axes
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
        **{f"orientation_{angle}": ORIENTATIONS[angle][i] for i, angle in enumerate(ANGLES)},
    }
    return [Finding(f"text.{name}", computed=value, setting=True) for name, value in values.items()]
