"""C programs of this package, compiled to the same bytes wherever it is done: ``make launcher``.

The compiler is zig's, from PyPI, of one exact release: it brings its own headers and the interfaces of an old glibc,
so that nothing of the machine it runs on gets into what it makes.  What was made is part of the package, in a folder
for each platform, with a record of what it was made from.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ...compiled_files import find_whole

COMPILER = "0.17.0"  # of ziglang; the same is asked for in pyproject.toml
FLAGS = ("-std=c99", "-O2", "-g0", "-Wall", "-Wextra", "-Werror")
"""Flags of every program on every platform."""


class CompileError(RuntimeError):
    """A program that cannot be compiled; the text says why."""


@dataclass(frozen=True)
class Target:
    """How a program is made for one platform of FMI."""

    zig: str
    """Name of the platform for zig."""
    result: str
    """Name of the file that is made."""
    flags: tuple[str, ...]
    """In addition to :data:`FLAGS`."""
    libraries: tuple[str, ...] = ()
    sources: tuple[str, ...] = ()
    """In addition to those of the program."""


@dataclass(frozen=True)
class Program:
    """A library or program in C: sources and headers in ``folder``, targets by platform (``linux64``, ...)."""

    name: str
    folder: Path
    sources: tuple[str, ...]
    headers: tuple[str, ...]
    targets: Mapping[str, Target]

    def sources_for(self, platform: str) -> tuple[str, ...]:
        """All sources of a target."""
        return (*self.sources, *self.targets[platform].sources)

    def path(self, platform: str) -> Path | None:
        """What was made for a platform; None if that is not among the targets."""
        target = self.targets.get(platform)
        return None if target is None else self.folder / platform / target.result

    def find_whole(self, platform: str) -> Path | None:
        """As :meth:`path`, for a file that is to be loaded or run.  Raises as :func:`..compiled_files.find_whole`."""
        return find_whole(self.record, platform) if platform in self.targets else None

    @property
    def record(self) -> Path:
        """The file that says what was made from what."""
        return self.folder / f"{self.name}.json"

    def recorded(self, made: Mapping[str, bytes]) -> str:
        """The text of :attr:`record` for what was made for each platform.

        Compiler, flags and the SHA-256 of all files that go in: where they are equal, so are the results.
        """
        names = [name for platform in self.targets for name in self.sources_for(platform)]
        files = {name: self.folder / name for name in (*names, *self.headers)}
        files |= {path.name: path for path in sorted(find_fmi_headers().glob("fmi2*.h"))}
        content = {
            "compiler": f"ziglang {COMPILER}",
            "flags": FLAGS,
            "targets": {platform: dataclasses.asdict(target) for platform, target in self.targets.items()},
            "sources": {name: _compute_digest(path.read_bytes()) for name, path in files.items()},
            "made": {platform: _compute_digest(data) for platform, data in made.items()},
        }
        return json.dumps(content, indent=2) + "\n"

    def compiled(self, platform: str) -> bytes:
        """The program for a platform, compiled now.  Raises CompileError."""
        import importlib.metadata  # a twentieth of the time that a master takes to start

        try:
            installed = importlib.metadata.version("ziglang")
        except importlib.metadata.PackageNotFoundError:
            installed = "none"
        if installed != COMPILER:
            raise CompileError(
                f"ziglang {COMPILER} is needed, {installed} is installed: pip install ziglang=={COMPILER}"
            )
        target = self.targets[platform]
        with tempfile.TemporaryDirectory() as folder:
            result = Path(folder) / target.result
            command = [sys.executable, "-I", "-m", "ziglang", "cc", "-target", target.zig, *FLAGS, *target.flags]
            command += ["-I", str(find_fmi_headers()), *self.sources_for(platform), "-o", str(result)]
            command += target.libraries
            environment = os.environ | {"ZIG_LOCAL_CACHE_DIR": folder}
            run = subprocess.run(command, cwd=self.folder, env=environment, capture_output=True, text=True)
            if run.returncode != 0:
                raise CompileError(f"{self.name} for {platform}: the compiler says:\n{run.stderr}")
            return result.read_bytes()

    def make(self) -> None:
        """Compile for all platforms, into the package.  Raises CompileError."""
        made = {platform: self.compiled(platform) for platform in self.targets}
        for platform, content in made.items():
            path = self.folder / platform / self.targets[platform].result
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(content)
            print(f"{path}  {len(content) / 1e3:.0f} kB")
        self.record.write_text(self.recorded(made), encoding="utf-8")


def find_fmi_headers() -> Path:
    """The folder of FMI's C headers, which FMPy's wheel carries."""
    import fmpy

    return Path(fmpy.__file__).parent / "c-code"


def _compute_digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
