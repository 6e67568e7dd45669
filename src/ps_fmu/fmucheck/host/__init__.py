"""A host for FMUs that is written in C and knows FMI 2.0 only: :mod:`..lives` runs it.

``host.c``: the life; ``task.c``: its input; ``report.c``: its output; ``settings.c``: what no FMU may change.
The compiled program is part of the package, so that no compiler is needed.
"""
