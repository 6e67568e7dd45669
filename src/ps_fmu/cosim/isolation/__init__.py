"""FMUs in processes of their own: what one of them does ends no more than the run, and the rows before are kept.

In steps the master calls stand-ins in C (``later.c``; ``client.c`` is the exchange), and the FMU's process carries them
out (``guest.c``).  Both share memory (``channel.h``); a step is one exchange.  All other calls go by a pipe
(:mod:`.guest_process` and :mod:`.guest`).
:class:`.instance.Isolation` is the way in.
"""
