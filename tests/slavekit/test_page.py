"""The example of elements in docs/slavekit.md runs, and does what its sentence says."""

import importlib.util
import re

import pytest
from support.page import PAGE

H = 0.02  # s


@pytest.fixture
def sensor(tmp_path):
    script = tmp_path / "level_sensor.py"
    script.write_text(re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)[2])
    spec = importlib.util.spec_from_file_location("level_sensor", script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    slave = module.LevelSensor(instance_name="sensor")
    slave.setup_experiment(0.0)
    slave.enter_initialization_mode()
    slave.exit_initialization_mode()
    return slave


def test_the_sensor_is_sampled_rounded_and_late(sensor):
    found = []
    for k in range(40):
        sensor.set_real([sensor.layout.find("level")], [0.0123 * k])
        sensor.do_step(k * H, H)
        found.append(sensor.y[0])
    sampled = [round(0.0123 * (k - (k + 1) % 5) / 0.01) * 0.01 if k >= 4 else 0.0 for k in range(40)]
    assert found == pytest.approx([0.0] * 10 + sampled[:-10], abs=1e-15)


def test_all_elements_are_in_the_table():
    from ps_fmu.slavekit.author import elements

    names = {name for name, value in vars(elements).items() if isinstance(value, type)}
    names = {name for name in names if issubclass(getattr(elements, name), elements.Element)} - {"Element"}
    table = PAGE.read_text().split("| element | does |")[1].split("\n\n")[0]
    assert set(re.findall(r"`(\w+)`", table)) == names
