"""The runs behind ``system/run.py``: a module per scenario, with ``run(options)``."""
