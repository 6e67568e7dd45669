"""Claims about results: Tables 1 and 2, Fig 10."""

from __future__ import annotations

from ..figures.fig06.results import CLAIMED_LIMIT, compute_reach
from ..figures.fig10.results import judge
from ..published import published_numbers
from .erratum import Erratum


def range_of_orientations() -> Erratum:
    """The claim of the conclusions."""
    reach = compute_reach()
    pitch = reach.pure[1]
    return Erratum(
        "Table 1, section 5",
        f"any roll, pitch and yaw within +-{CLAIMED_LIMIT:g} deg can be reached",
        f"any within +-{reach.cube:.2f} deg",
        f"inverse kinematics and stroke: pitch alone reaches {pitch[0]:+.2f} to {pitch[1]:+.2f} deg, and the largest "
        f"cube of roll, pitch and yaw is that of +-{reach.cube:.2f} deg; the error is by how much the cube is "
        "overstated. Table 1 holds the extremes of each angle wherever they occur",
        error_printed=CLAIMED_LIMIT - reach.cube,
        unit="deg",
    )


def rejection_of_table_2() -> Erratum:
    """Table 2: a quotient."""
    numbers = published_numbers()
    passive, active, said = (numbers[f"table2.roll_{what}_3"].value for what in ("passive", "active", "rejection"))
    follows = 100.0 * (1.0 - active / passive)
    return Erratum(
        "Table 2, (8.5, 0, 0) deg, axis 3",
        f"{said:g} %",
        f"{follows:.2f} %",
        f"1 - {active:g} / {passive:g}, the RMS values beside it",
        error_printed=abs(said - follows),
        unit="points",
    )


def verdict_on_the_lighter_module() -> Erratum:
    """Fig 10: the critical point."""
    delay = published_numbers()["text.delay"].value
    lsm = judge("LSM", delay)
    return Erratum(
        "Fig 10, section 4.2",
        f"LSM with {delay:g} s delay is unstable: margins of +C K_we against -1",
        "stable: by (48) the critical point is +1",
        f"argument principle: {lsm.unstable_poles} poles in the right half-plane about +1, {lsm.encirclements} if the "
        f"point were -1; the rightmost pole of the suspension is at {lsm.rightmost.real:.2f} "
        f"{lsm.rightmost.imag:+.2f}i rad/s; the loop becomes unstable beyond a delay of {1e3 * lsm.delay_limit:.1f} "
        f"ms, by bisection {1e3 * lsm.bisected:.1f} ms",
    )


ENTRIES = (range_of_orientations, rejection_of_table_2, verdict_on_the_lighter_module)
