"""Runs a scenario of the pointing manipulator: ``ps-fmu run`` for those who work in a checkout."""

from __future__ import annotations

import sys

try:
    from ps_fmu.child_processes import collect_rarely, use_one_thread

    use_one_thread()  # before numpy is imported
    with collect_rarely():
        from ps_fmu.run_command import main
    from ps_fmu.terminal import run_command
except KeyboardInterrupt:
    sys.exit(130)
except ModuleNotFoundError as missing:
    sys.exit(f"{missing}: run `make run` once, then use .venv/bin/python system/run.py")

if __name__ == "__main__":
    sys.exit(run_command(main))
