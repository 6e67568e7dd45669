"""The script that pythonfmu's native library starts from inside an FMU."""

from __future__ import annotations

_SOURCE = '''\
"""Entry point of this FMU: the native library executes this file at each instantiation.

It takes the class that is defined here; the model itself is {package}/{module}.py.
"""

import importlib
import os
import sys
import traceback

try:
    _package = sys.modules.get("{package}")
    if _package is not None and not os.path.isdir(_package.__path__[0]):
        # The FMU was loaded before, from a folder that is gone: files that are read later would be missing.
        importlib.invalidate_caches()
        for _name in [name for name in sys.modules if name.partition(".")[0] == "{package}"]:
            del sys.modules[_name]
    {model} = importlib.import_module("{package}.{module}").{model}
    globals()["{model}"] = {model}  # the library executes this file with locals of their own
    importlib.import_module("{package}.slavekit.author.guard").keep_alive(globals())  # see there
except BaseException:
    traceback.print_exc()  # the library tells only hosts that log
    # It logs what repr() gives, which has to be safe as a printf format.
    _failure = type("Failure", (ImportError,), {{"__repr__": ImportError.__str__}})
    raise _failure(traceback.format_exc().replace("%", "%%")) from None
finally:
    if os.path.isfile(os.path.join(sys.path[0], __name__ + ".py")):
        # One entry more at each instantiation, by the library.  Imports in other threads may be iterating over this
        # list: they would miss the entry after the one they have come to.
        sys.path = sys.path[1:]
'''


def entry_source(package: str, module: str, model: str) -> bytes:
    """The script for class ``model`` in ``package.module``."""
    return _SOURCE.format(package=package, module=module, model=model).encode()
