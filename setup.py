"""Puts copies of the FMUs' sources and of the system files into a wheel, into ``ps_fmu/product``.

They lie outside of the package, where readers look for them, and setuptools has no setting for data from elsewhere.
All else is in pyproject.toml.
"""

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent
UNWANTED = shutil.ignore_patterns("__pycache__", "run.py", ".*")


class BuildWithProductFiles(build_py):
    """As usual, and then the folders ``fmus`` and ``system``; an editable installation uses those of the checkout."""

    def run(self):
        super().run()
        if self.editable_mode:
            return
        for name in ("fmus", "system"):
            target = Path(self.build_lib, "ps_fmu", "product", name)
            shutil.rmtree(target, ignore_errors=True)  # of an earlier build
            shutil.copytree(ROOT / name, target, ignore=UNWANTED)


setup(cmdclass={"build_py": BuildWithProductFiles})
