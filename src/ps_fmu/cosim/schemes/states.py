"""States of FMUs that are kept during a step."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping

from ..errors import SlaveError
from ..fmu_instance import FmuInstance

log = logging.getLogger("ps_fmu.cosim")


def keep_states(instances: Iterable[FmuInstance]) -> dict[FmuInstance, int]:
    """The present states; give them back by :func:`release_states`.  Raises :class:`SlaveError`, none is kept then."""
    states: dict[FmuInstance, int] = {}
    try:
        for instance in instances:
            states[instance] = instance.get_state()
    except BaseException:
        release_states(states)
        raise
    return states


def release_states(states: Mapping[FmuInstance, int]) -> None:
    """Give states back; an FMU that refuses is named in a warning, for what went wrong before says more."""
    for instance, state in states.items():
        try:
            instance.free_state(state)
        except SlaveError as error:
            log.warning("%s", error)
