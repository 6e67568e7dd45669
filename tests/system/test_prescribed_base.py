"""The plant on a hub that another FMU is, in our master, against the plant with its own bus."""

from pathlib import Path

import numpy as np
import pytest
from support.claims import verify_claim
from support.hub import cube, push

from ps_fmu.cosim import Master, read_system
from ps_fmu.cosim.structure import Component, Connection, PortName, System
from ps_fmu.disturbance.recording import HEADER
from ps_fmu.results.observers.sampler import SampleObserver
from ps_fmu.slavekit.pack.foreign import build_script

SSD = Path(__file__).parents[2] / "system" / "SystemStructure.ssd"
SCRIPT = Path(__file__).parent / "models" / "rigid_hub.py"
BUS = cube(60.0)
RIGID = {f"bus.mode_{i}.frequency": 0.0 for i in range(1, 7)}
OWN_BUS = {
    "bus.mass": BUS.mass,
    "bus.com.z": float(BUS.com_B[2]),
    **{f"bus.inertia.{axis}{axis}": float(BUS.inertia_B[0, 0]) for axis in "xyz"},
}
HUB = {"mass": BUS.mass, "com_z": float(BUS.com_B[2]), "inertia": float(BUS.inertia_B[0, 0])}
PAIRS = ("xx", "xy", "xz", "yy", "yz", "zz")
DURATION = 0.15  # s
SEEN = tuple(f"plant.payload_rotation.{axis}" for axis in "xyz") + tuple(
    f"plant.fine_displacement_{leg}" for leg in (1, 2, 3)
)


def connect_all(source, target, names):
    """Of pairs of names, output of one component and input of the other."""
    return [Connection(PortName(source, out), PortName(target, into), 0) for out, into in names]


def pair(plant, hub, parts="xyz"):
    """Names of a vector's parts in both."""
    return [(f"{plant}.{part}", f"{hub}_{part}") for part in parts]


@pytest.fixture(scope="module")
def systems(built_fmus, tmp_path_factory):
    """The plant with its own bus, and the plant on the hub, both pushed by the disturbance source."""
    folder = tmp_path_factory.mktemp("hub")
    fmu, _ = build_script(SCRIPT, output=folder)
    recording, time = folder / "push.csv", np.arange(0.0, 0.2, 1e-4)
    rows = np.column_stack([time, [push(t) for t in time]])
    np.savetxt(recording, rows, delimiter=",", header=",".join(HEADER), comments="")
    given = read_system(SSD, built_fmus)
    files = {name: given.component(name).source for name in ("disturbance", "plant")} | {"hub": fmu}

    def make(values, components, connections):
        parts = tuple(Component(name, files[name], (), {}, 0) for name in components)
        values = {f"plant.{name}": value for name, value in values.items()}
        quiet = {"disturbance.noise.enabled": False, "disturbance.recording.path": str(recording)}
        return System(SSD, parts, tuple(connections)).with_parameters({**values, **quiet})

    wrench = [(f"base_{kind}.{axis}", kind, axis) for kind in ("force", "torque") for axis in "xyz"]
    own = make(
        {**RIGID, **OWN_BUS}, ("disturbance", "plant"),
        connect_all("disturbance", "plant", [(name, name) for name, _, _ in wrench]),
    )  # fmt: skip
    motion = [name for kind in ("acceleration", "angular_acceleration", "angular_velocity")
              for name in pair(f"prescribed_{kind}", kind)]  # fmt: skip
    reaction = [name for kind in ("bus_force", "bus_torque", "locked_com") for name in pair(kind, kind)]
    reaction += [*pair("locked_inertia", "locked_inertia", PAIRS), ("locked_mass", "locked_mass")]
    hosted = make(
        {**RIGID, "base": "prescribed"}, ("disturbance", "hub", "plant"),
        [
            *connect_all("disturbance", "hub", [(name, f"{kind}_{axis}") for name, kind, axis in wrench]),
            *connect_all("hub", "plant", [(hub, plant) for plant, hub in motion]),
            *connect_all("plant", "hub", reaction),
        ],
    ).with_parameters({f"hub.{name}": value for name, value in HUB.items()})  # fmt: skip
    return own, hosted


def simulate(system, h):
    """Rows of SEEN at each step, (n, 6)."""
    steps = round(DURATION / h)
    with Master(system, h, scheme="gauss-seidel") as master:
        master.initialise()
        samples = SampleObserver(master.columns, SEEN, range(1, steps + 1))
        master.run(steps * h, [samples])
    return samples.values(*SEEN)


def test_the_payload_moves_as_on_the_own_bus(systems):
    """To second order in the step; with 1e-4 s on a hub of 60 kg within 3e-5 of the motion."""
    errors = []
    for h in (2e-4, 1e-4):
        own, hosted = (simulate(system, h) for system in systems)
        largest = np.abs(own).max(axis=0)
        assert largest[:3].max() > 1e-7  # rad
        errors.append((np.abs(hosted - own).max(axis=0) / largest).max())
    verify_claim(
        "model.prescribed_base",
        claim="Motion of the payload on a bus that another program moves",
        where="plant with `base = prescribed`",
        reference="the same bus as the plant's own; at steps of 0.1 ms, second order in the step",
        error=errors[1],
        bound=3e-5,
        unit="of the motion",
    )
    assert 3.5 < errors[0] / errors[1] < 4.5
