"""Memory of an instance goes when it is freed, not at some later collection: up to 20 MB, the disturbance source."""

import gc
import sys
import weakref

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from support.host import unpack
from support.models import MODELS, Host
from support.twins import InFmpy

from ps_fmu.slavekit.author.slave import Refused

SETTINGS = [
    ("manipulator_plant", {}),
    ("pointing_commander", {"target__roll": 0.1}),  # slews, with an event in each step
    ("feedforward_isolator", {}),
    ("feedforward_isolator", {"sample_time": 2e-4, "delay": 3e-4, "force_limit": 0.05}),
    ("disturbance_source", {}),
    ("disturbance_source", {"noise__multisine": True}),
    ("inertial_sensors", {"sample_time": 2e-4, "latency": 3e-4}),
]
H = 1e-4  # s


@pytest.fixture
def no_collection():
    """Only what nobody refers to goes, as soon as nobody does."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


@pytest.mark.parametrize(("folder", "start"), SETTINGS)
def test_slaves_are_in_no_cycle(folder, start, no_collection):
    host = Host(folder, **start).run_mode()
    host.step(H, 20)
    state = host.save()
    host.step(H, 5)
    with pytest.raises(Refused):
        host.slave.do_step(-1.0, H)
    host.restore(state, 20)
    host.step(H, 20)
    slave, memory = weakref.ref(host.slave), weakref.ref(host.slave._buffer.data.base)
    del host
    assert slave() is None
    assert memory() is None


@pytest.mark.parametrize("model", MODELS)
def test_a_freed_instance_is_gone(model, built_fmus, tmp_path, no_collection):
    """Pythonfmu's library counts references wrongly where there was an exception, and guard.py against that."""
    folder = unpack(built_fmus / f"{model}.fmu", tmp_path / model)
    names = ("to be freed", "this one, too")
    fmus = [InFmpy(folder, name).fmu for name in names]
    for fmu in fmus:
        for call in (fmu.reset, fmu.setupExperiment, fmu.enterInitializationMode, fmu.exitInitializationMode):
            call()
        for i in range(20):
            fmu.doStep(i * H, H)
    content = fmus[0].serializeFMUstate(state := fmus[0].getFMUstate())
    fmus[0].setFMUstate(fmus[0].deSerializeFMUstate(content))
    for mistake in (
        lambda: fmus[0].deSerializeFMUstate(content[:-1]),
        lambda: fmus[0].setFMUstate(None),
        lambda: fmus[1].setFMUstate(state),
        lambda: fmus[0].getReal([999_999]),
        lambda: fmus[1].setReal([0], [np.nan]),
        lambda: fmus[1].doStep(-1.0, H),
        fmus[0].enterInitializationMode,
    ):
        with pytest.raises(FMICallException):
            mistake()
    (script,) = (folder / "resources").glob(f"ps_fmu_*/{MODELS[model]}_*.py")
    slaves = getattr(sys.modules[f"{script.parent.name}.{script.stem}"], model).instances

    def alive():
        return sorted(slave.instance_name for slave in slaves if slave.instance_name in names)

    assert alive() == sorted(names)
    for fmu in fmus:
        fmu.freeInstance()
    assert alive() == []
