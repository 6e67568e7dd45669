"""CPU time of the start of a system of 64 FMUs with thousands of connections, and of a step, per connection.

``python benchmarks/many_fmus.py`` builds a small FMU in C (as many inputs as outputs, each output its input), and wires
64 of them in rings.  Times are those of the process (``time.process_time``), minimum of three.  Exit code 1 if a target
is missed.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Mapping
from pathlib import Path

from ps_fmu.cosim import Master, read_system
from ps_fmu.slavekit.launcher.c_program import find_fmi_headers

FMUS = 64
STEPS = 1000
MOST_START = 3.0
"""With all connections [s]."""
MOST_GROWTH = 1.6
"""Of the cost of a connection, from the least to the most of them; data of 4000 are in no first-level cache."""
REFUSED = Path(__file__).with_name("refused.c")
_SOURCE = r"""
#include <stdlib.h>
#include <string.h>
#include "fmi2Functions.h"
#define ACCESS(type) \
    fmi2Status fmi2Get##type(fmi2Component c, const fmi2ValueReference v[], size_t n, fmi2##type x[]) \
    { (void)c, (void)v, (void)n, (void)x; return fmi2Error; } \
    fmi2Status fmi2Set##type(fmi2Component c, const fmi2ValueReference v[], size_t n, const fmi2##type x[]) \
    { (void)c, (void)v, (void)n, (void)x; return fmi2Error; }
ACCESS(Integer) ACCESS(Boolean)
fmi2Component fmi2Instantiate(fmi2String n, fmi2Type t, fmi2String g, fmi2String r, const fmi2CallbackFunctions *c,
                              fmi2Boolean v, fmi2Boolean l)
{ (void)n, (void)t, (void)g, (void)r, (void)c, (void)v, (void)l; return calloc(COUNT, sizeof(double)); }
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference v[], size_t n, const fmi2Real x[])
{ for (size_t i = 0; i < n; i++) ((double *)c)[v[i] % COUNT] = x[i]; return fmi2OK; }
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference v[], size_t n, fmi2Real x[])
{ for (size_t i = 0; i < n; i++) x[i] = ((double *)c)[v[i] % COUNT]; return fmi2OK; }
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean b)
{ (void)c, (void)t, (void)h, (void)b; return fmi2OK; }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean a, fmi2Real b, fmi2Real d, fmi2Boolean e, fmi2Real f)
{ (void)c, (void)a, (void)b, (void)d, (void)e, (void)f; return fmi2OK; }
#define PLAIN(name) fmi2Status name(fmi2Component c) { (void)c; return fmi2OK; }
PLAIN(fmi2EnterInitializationMode) PLAIN(fmi2ExitInitializationMode) PLAIN(fmi2Terminate)
"""


def build_fmu(folder: Path, ports: int) -> Path:
    """An FMU with as many inputs and outputs."""
    source, library = folder / "many.c", folder / "many.so"
    source.write_text(_SOURCE)
    command = [sys.executable, "-I", "-m", "ziglang", "cc", "-O2", "-shared", "-fPIC", f"-DCOUNT={ports}"]
    subprocess.run([*command, f"-I{find_fmi_headers()}", str(source), str(REFUSED), "-o", str(library)], check=True)
    variable = '<ScalarVariable name="{}{}" valueReference="{}" causality="{}"><Real{}/></ScalarVariable>'
    variables = "".join(variable.format("u", i, i, "input", ' start="0"') for i in range(ports))
    variables += "".join(variable.format("y", i, ports + i, "output", "") for i in range(ports))
    unknowns = "".join(f'<Unknown index="{ports + i + 1}" dependencies="{i + 1}"/>' for i in range(ports))
    fmu = folder / "many.fmu"
    with zipfile.ZipFile(fmu, "w") as archive:
        archive.writestr(
            "modelDescription.xml",
            f'<?xml version="1.0"?><fmiModelDescription fmiVersion="2.0" modelName="many" guid="m">'
            f'<CoSimulation modelIdentifier="many"/><ModelVariables>{variables}</ModelVariables><ModelStructure>'
            f"<Outputs>{unknowns}</Outputs><InitialUnknowns>{unknowns}</InitialUnknowns></ModelStructure>"
            "</fmiModelDescription>",
        )
        archive.write(library, "binaries/linux64/many.so")
    return fmu


def write_system(folder: Path, ports: int, fmus: int = FMUS) -> Path:
    """64 of them, each output to the input of another one."""
    lists = "".join(
        f'<ssd:Connector name="{way}{i}" kind="{kind}"><ssc:Real/></ssd:Connector>'
        for way, kind in (("u", "input"), ("y", "output"))
        for i in range(ports)
    )
    components = "".join(
        f'<ssd:Component name="f{n}" source="many.fmu"><ssd:Connectors>{lists}</ssd:Connectors></ssd:Component>'
        for n in range(fmus)
    )
    wires = "".join(
        f'<ssd:Connection startElement="f{n}" startConnector="y{i}" endElement="f{(n + 1 + i) % fmus}" '
        f'endConnector="u{i}"/>'
        for n in range(fmus)
        for i in range(ports)
    )
    space = "http://ssp-standard.org/SSP1/SystemStructure"
    path = folder / "many.ssd"
    path.write_text(
        f'<ssd:SystemStructureDescription xmlns:ssd="{space}Description" xmlns:ssc="{space}Common" version="1.0" '
        f'name="many"><ssd:System name="many"><ssd:Elements>{components}</ssd:Elements><ssd:Connections>{wires}'
        "</ssd:Connections></ssd:System></ssd:SystemStructureDescription>"
    )
    return path


def measure(path: Path) -> tuple[float, float]:
    """CPU seconds until the first step, and of a step."""
    begin = time.process_time()
    with Master(read_system(path), 1e-3) as master:
        master.initialise()
        ready = time.process_time()
        master.run(STEPS * 1e-3)
        return ready - begin, (time.process_time() - ready) / STEPS


def find_missed(found: Mapping[int, tuple[float, float]]) -> list[str]:
    """Targets that are missed, from the seconds of start and step by the number of connections."""
    fewest, most = min(found), max(found)
    texts = []
    if found[most][0] > MOST_START:
        texts.append(f"start with {most} connections: {found[most][0]:.2f} s, {MOST_START:g} s are the target")
    for what, place in (("start", 0), ("step", 1)):
        growth = found[most][place] / most / (found[fewest][place] / fewest)
        if growth > MOST_GROWTH:
            texts.append(f"{what} per connection: {growth:.2f} times that of {fewest}, {MOST_GROWTH:g} are the target")
    return texts


def main() -> int:
    """Print a row for each number of connections; returns the exit code."""
    print("connections  start [s]  start per connection [us]  step [us]  step per connection [ns]")
    found = {}
    for ports in (8, 16, 32, 63):
        with tempfile.TemporaryDirectory() as name:
            build_fmu(Path(name), ports)
            path = write_system(Path(name), ports)
            start, step = map(min, zip(*(measure(path) for _ in range(3)), strict=True))
        count = FMUS * ports
        found[count] = start, step
        print(f"{count:11d} {start:10.2f} {1e6 * start / count:26.0f} {1e6 * step:10.1f} {1e9 * step / count:24.1f}")
    missed = find_missed(found)
    print(*missed, sep="\n", end="\n" if missed else "", file=sys.stderr)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
