"""A host for FMUs that is written in C and knows nothing but FMI 2.0: :mod:`..lives` runs it.

``host.c``: the life; ``plan.c``: what it is told; ``report.c``: what it tells; ``settings.c``: what no FMU may change.
The compiled program is part of the package, so that no compiler is needed.
"""
