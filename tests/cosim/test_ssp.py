"""What makes a system impossible to write as an archive."""

import shutil

import pytest
from support.cosim import OSCILLATOR, ssd_text

from ps_fmu.cosim import SystemFileError, UsageError, WiringError, read_system, write_ssp

EXPERIMENT = """
<ssd:DefaultExperiment startTime="0" stopTime="2"><ssd:Annotations><ssc:Annotation type="com.opensimulationplatform">
<osp:Algorithm xmlns:osp="http://opensimulationplatform.com/SSP/OSPAnnotations">
<osp:FixedStepAlgorithm baseStepSize="1e-2"/></osp:Algorithm></ssc:Annotation></ssd:Annotations></ssd:DefaultExperiment>
"""


@pytest.fixture
def folder(toys, tmp_path):
    (tmp_path / "resources").mkdir()
    for name in ("ToyMass", "ToySpring"):
        shutil.copy(toys / f"{name}.fmu", tmp_path / "resources")
    return tmp_path


def write(folder, text):
    (folder / "SystemStructure.ssd").write_text(text)
    system = read_system(folder)
    write_ssp(system, folder / "out.ssp")
    return system, read_system(folder / "out.ssp")


def test_a_system_survives_the_round_trip(folder):
    system, again = write(folder, ssd_text(*OSCILLATOR, after=EXPERIMENT))
    assert again.experiment == system.experiment
    assert [(c.source, c.target) for c in again.connections] == [(c.source, c.target) for c in system.connections]
    assert not (folder / "out.ssp.partial").exists()


def test_a_step_that_a_component_states_survives_the_round_trip(folder):
    hint = (
        '<ssd:Annotations><ssc:Annotation type="com.opensimulationplatform"><osp:StepSizeHint value="0.04" '
        'xmlns:osp="http://opensimulationplatform.com/SSP/OSPAnnotations"/></ssc:Annotation></ssd:Annotations>'
    )
    text = ssd_text(*OSCILLATOR, after=EXPERIMENT).replace("</ssd:Connectors>", f"</ssd:Connectors>{hint}", 1)
    system, again = write(folder, text)
    assert [one.step for one in again.components] == [one.step for one in system.components] == [0.04, None]


@pytest.mark.parametrize(
    ("change", "message"),
    [(("stopTime", "startTime"), "no stop time"), (("FixedStepAlgorithm", "Other"), "no step")],
)
def test_step_and_stop_time_have_to_be_stated(folder, change, message):
    text = ssd_text(*OSCILLATOR, after=EXPERIMENT.replace('startTime="0" ', "").replace(*change))
    with pytest.raises(UsageError, match=message):
        write(folder, text)


def test_names_that_some_tools_cannot_unpack_are_refused(folder):
    (folder / "resources" / "ToyMass.fmu").rename(folder / "resources" / "Toy Mass.fmu")
    with pytest.raises(SystemFileError, match="letters, digits"):
        write(folder, ssd_text(*OSCILLATOR, after=EXPERIMENT).replace("ToyMass.fmu", "Toy Mass.fmu"))


@pytest.mark.parametrize(
    ("name", "reason"),
    [("my spring", "letters, digits and _ only"), ("masses", "component 'mass' is a prefix of 'masses'")],
)
def test_names_that_some_tools_confuse_are_refused(folder, name, reason):
    text = ssd_text(*OSCILLATOR, after=EXPERIMENT).replace('"spring"', f'"{name}"')
    with pytest.raises(WiringError, match=reason):
        write(folder, text)


def test_conversions_that_some_tools_do_wrong_are_refused(folder):
    text = ssd_text(*OSCILLATOR, after=EXPERIMENT)
    gain = '"><ssc:LinearTransformation factor="2"/></ssd:Connection>\n</ssd:Connections>'
    with pytest.raises(WiringError, match=r"line 26: connection spring\.force -> mass\.force: converts the value"):
        write(folder, text.replace('"/>\n</ssd:Connections>', gain))


def test_two_fmus_of_one_name_are_refused(folder, rewrite):
    (folder / "resources" / "other").mkdir()
    changed = rewrite(folder / "resources" / "ToyMass.fmu", {"<fmiModelDescription": '<fmiModelDescription author="x"'})
    shutil.copy(changed, folder / "resources" / "other")
    text = ssd_text({"one": "ToyMass", "two": "ToyMass"}, [], after=EXPERIMENT)
    before, _, after = text.rpartition("resources/ToyMass.fmu")
    with pytest.raises(SystemFileError, match=r"different file ToyMass\.fmu"):
        write(folder, before + "resources/other/ToyMass.fmu" + after)
