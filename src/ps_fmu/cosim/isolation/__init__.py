"""FMUs in processes of their own: what one of them does ends no more than the run, and the rows before are kept.

The master calls a stand-in for the library (``calls.c``, and ``later.c`` in steps; ``client.c`` is the exchange); the
FMU's process (``guest.c``) carries the calls out.  Both share memory (``channel.h``); a step is one exchange.
:class:`.instance.Isolation` is the way in, :mod:`.options` has the options of commands.
"""
