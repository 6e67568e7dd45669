"""The native launcher: the library of an FMU that hosts load, in front of pythonfmu's own.

``text.c``: texts and paths; ``find.c``: which Python; ``python.c``: attaching, starting, threads; ``instance.c``:
instances and their messages; ``kernel.c``, ``elements.c``, ``timed.c`` and ``native.c``: what is done without Python;
``floats.c``: floating-point settings; ``launcher.c`` and ``status.c``: the functions of FMI 2.0; ``platform.h`` and the
folders ``posix`` and ``windows``: what differs between operating systems.  The kernel with its elements is in the
library of :mod:`ps_fmu.numerics`, too, for the steps that Python makes.  The built libraries are part of the package:
users need no compiler; :mod:`.compile` makes them.
"""
