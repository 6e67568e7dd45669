"""
The FMUs in a C program
=======================

A simulator written in C loads an FMU as a shared library. The program contains no Python. The
machine needs a Python with numpy, which the FMU finds by itself. This tutorial writes such a program,
compiles and runs it, and compares with FMPy.
"""

# sphinx_gallery_thumbnail_path = "docs/step.svg"

# %%
# The program
# -----------
#
# Some fifty lines: load the library, look up the functions, initialise, push the bus with 10 N
# for 0.1 s, print the rotation of the payload. ``fmi2Functions.h`` is the header of the FMI
# standard; FMPy brings a copy.

PROGRAM = r"""
#include "fmi2Functions.h"
#include <dlfcn.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#define MUST(condition) if (!(condition)) { fprintf(stderr, "failed: %s\n", #condition); exit(1); }
#define LOAD(name) fmi2##name##TYPE *name = (fmi2##name##TYPE *)dlsym(library, "fmi2" #name); MUST(name)

static void log_message(void *environment, fmi2String instance, fmi2Status status, fmi2String category,
                        fmi2String message, ...)
{
    va_list arguments;
    va_start(arguments, message);
    vfprintf(stderr, message, arguments);
    va_end(arguments);
}

/* host LIBRARY RESOURCES-URI GUID FORCE-REFERENCE ROTATION-REFERENCE */
int main(int argc, char **argv)
{
    MUST(argc == 6);
    void *library = dlopen(argv[1], RTLD_NOW | RTLD_LOCAL);
    MUST(library != NULL);
    LOAD(Instantiate) LOAD(SetupExperiment) LOAD(EnterInitializationMode) LOAD(ExitInitializationMode)
    LOAD(SetReal) LOAD(GetReal) LOAD(DoStep) LOAD(Terminate) LOAD(FreeInstance)

    fmi2CallbackFunctions callbacks = {log_message, calloc, free, NULL, NULL};
    fmi2ValueReference force = atoi(argv[4]), rotation = atoi(argv[5]);
    fmi2Component plant = Instantiate(
        "plant", fmi2CoSimulation, argv[3], argv[2], &callbacks, fmi2False, fmi2False);
    MUST(plant != NULL);
    MUST(SetupExperiment(plant, fmi2False, 0.0, 0.0, fmi2False, 0.0) == fmi2OK);
    MUST(EnterInitializationMode(plant) == fmi2OK);
    MUST(ExitInitializationMode(plant) == fmi2OK);

    double h = 1e-4, push = 10.0, angle;  /* s, N, rad */
    MUST(SetReal(plant, &force, 1, &push) == fmi2OK);
    for (long k = 0; k < 1000; k++)
        MUST(DoStep(plant, k * h, h, fmi2True) == fmi2OK);
    MUST(GetReal(plant, &rotation, 1, &angle) == fmi2OK);
    printf("%.17g\n", angle);
    MUST(Terminate(plant) == fmi2OK);
    FreeInstance(plant);
    return 0;
}
"""

# %%
# Compile it
# ----------
#
# With the C compiler of the machine, or with that of ``pip install ziglang``::
#
#     cc -I fmpy/c-code -o host host.c -ldl

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import fmpy

folder = tempfile.TemporaryDirectory()
source, host = Path(folder.name, "host.c"), Path(folder.name, "host")
source.write_text(PROGRAM)
headers = Path(fmpy.__file__).parent / "c-code"
compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
command = [compiler] if compiler else [sys.executable, "-m", "ziglang", "cc"]
subprocess.run(
    [*command, "-O1", f"-I{headers}", "-o", str(host), str(source), "-ldl"], check=True
)
print("compiled:", host.stat().st_size // 1000, "kB")

# %%
# Run it
# ------
#
# An FMU is a zip archive. The program needs the library in it, the URI of its resources, its
# GUID, and the value references of the variables, which stand in ``modelDescription.xml``.
# ``PS_FMU_PYTHON`` names the Python that the FMU takes; without it the FMU looks for one on
# ``PATH``.

from ps_fmu.runs.built_fmus import find_built_folder

fmu = find_built_folder() / "ManipulatorPlant.fmu"
unpacked = Path(fmpy.extract(fmu, unzipdir=str(Path(folder.name, "plant"))))
description = fmpy.read_model_description(fmu)
references = {variable.name: variable.valueReference for variable in description.modelVariables}
done = subprocess.run(
    [
        str(host),
        str(unpacked / "binaries" / "linux64" / "ManipulatorPlant.so"),
        (unpacked / "resources").as_uri(),
        description.guid,
        str(references["base_force.x"]),
        str(references["payload_rotation.y"]),
    ],
    env={"PS_FMU_PYTHON": sys.executable, "OMP_NUM_THREADS": "1"},
    capture_output=True,
    text=True,
    check=True,
)
in_c = float(done.stdout)
print(f"C program: {in_c:.12e} rad")

# %%
# The same in FMPy
# ----------------

result = fmpy.simulate_fmu(
    fmu,
    stop_time=0.1,
    output_interval=1e-4,
    start_values={"base_force.x": 10.0},
    output=["payload_rotation.y"],
)
in_fmpy = float(result["payload_rotation.y"][-1])
print(f"FMPy:      {in_fmpy:.12e} rad")
print(f"relative difference: {abs(in_c / in_fmpy - 1.0):.0e}")
folder.cleanup()

# %%
# The difference is rounding: FMPy forms each step as a difference of times, so steps differ in
# their last bit.
#
# A step of the plant costs 0.2 us in a C program: between events a launcher in the FMU makes it
# without Python. For a machine without Python, ``ps-fmu build --bundle`` puts one into the FMU.
# ``tests/host`` has larger hosts: several FMUs, threads, reloading, faults.
