"""Compiles C for this processor and loads it; what was compiled once is found again.

Libraries lie in ``$XDG_CACHE_HOME/youbot-workbench`` (``~/.cache`` where that is not set) under a
hash of text, compiler and processor.  Nothing is loaded that somebody else could have written.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
from functools import lru_cache
from pathlib import Path

# Results stay those of IEEE arithmetic but for the order of a product and a sum in one
# instruction; nobody reads errno, traps or the sign of zero.  With -O3 gcc 12 does not finish some
# functions within minutes; what makes them fast is the vectors.
FLAGS = (
    "-O2", "-ftree-vectorize", "-fvect-cost-model=dynamic", "-march=native", "-std=gnu11", "-fPIC",
    "-shared", "-fno-math-errno", "-fno-trapping-math", "-fno-signed-zeros", "-w",
)  # fmt: skip
# For functions that never ask whether a number is finite; the largest and smallest of two are then
# one instruction.
FINITE = ("-ffinite-math-only",)
LONGEST_BUILD, PATIENCE = 60.0, 2.0  # s, in all and without a word
_libraries: dict[str, ctypes.CDLL] = {}
_failed: dict[str, str] = {}


class NoCompiler(RuntimeError):
    """C cannot be compiled here; the message says why."""


def load(text: str, flags: tuple[str, ...] = ()) -> ctypes.CDLL:
    """Compile a C text, or find what was compiled before, and load it.

    Args:
        text: of the functions.
        flags: for the compiler beyond ``FLAGS``.

    Raises:
        NoCompiler: there is no C compiler, or it fails.
    """
    compiler, identity = _compiler()
    key = hashlib.sha256("\0".join((text, identity, *FLAGS, *flags)).encode()).hexdigest()[:32]
    if key in _failed:
        raise NoCompiler(_failed[key])
    try:
        if key not in _libraries:
            _libraries[key] = _loaded(key, text, (*compiler, *FLAGS, *flags))
    except NoCompiler as error:
        _failed[key] = str(error)
        raise
    return _libraries[key]


def _loaded(key: str, text: str, compiler: tuple[str, ...]) -> ctypes.CDLL:
    folder = cache_folder()
    if folder is None:
        with tempfile.TemporaryDirectory(prefix="youbot-") as private:
            return ctypes.CDLL(_compiled(text, Path(private) / f"{key}.so", compiler))
    library = folder / f"{key}.so"
    if not (library.is_file() and ours(library)):
        _compiled(text, library, compiler)
    return ctypes.CDLL(str(library))


def _compiled(text: str, library: Path, compiler: tuple[str, ...]) -> str:
    """Write the library, whole or not at all."""
    with tempfile.TemporaryDirectory(prefix=".building-", dir=library.parent) as folder:
        source, made = Path(folder) / "kernel.c", Path(folder) / "kernel.so"
        source.write_text(text)
        command = [*compiler, "-o", str(made), str(source), "-lm"]
        # A session of its own: what the compiler starts ends with it.
        with subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
            start_new_session=True,
        ) as process:  # fmt: skip
            try:
                try:
                    _, words = process.communicate(timeout=PATIENCE)
                except subprocess.TimeoutExpired:
                    print("compiling the equations, once on this machine ...", file=sys.stderr)
                    _, words = process.communicate(timeout=LONGEST_BUILD - PATIENCE)
            except BaseException as error:
                os.killpg(process.pid, signal.SIGKILL)
                if isinstance(error, subprocess.TimeoutExpired):
                    late = f"{compiler[0]} takes more than {LONGEST_BUILD:g} s"
                    raise NoCompiler(late) from error
                raise
        if process.returncode:
            first = (words.strip().splitlines() or [f"status {process.returncode}"])[0]
            raise NoCompiler(f"{compiler[0]} fails: {first}")
        made.chmod(0o700)
        os.replace(made, library)
    return str(library)


def cache_folder() -> Path | None:
    """The folder of compiled libraries, made where there is none; None where it is not safe."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    try:
        home = Path(base) if os.path.isabs(base) else Path.home() / ".cache"
        folder = home / "youbot-workbench"
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        return folder if ours(folder) and os.access(folder, os.W_OK) else None
    except (OSError, RuntimeError):  # no home, a full or a read-only disk
        return None


def ours(path: Path) -> bool:
    """Whether this user owns a file or folder, and nobody else can write to it."""
    found = path.lstat()
    others = found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return found.st_uid == os.getuid() and not others and not stat.S_ISLNK(found.st_mode)


def _compiler() -> tuple[tuple[str, ...], str]:
    """The command of the C compiler, and what identifies it and the processor."""
    if os.name != "posix":
        raise NoCompiler("compiling is for Linux and macOS")
    given = os.environ.get("CC", "").split()
    for command in (given, ["cc"], ["gcc"], ["clang"]):
        found = shutil.which(command[0]) if command else None
        if found:
            whole = (found, *command[1:])
            return whole, _identity(whole)
    raise NoCompiler("no C compiler (cc, gcc, clang) is on the path")


@lru_cache(maxsize=8)
def _identity(compiler: tuple[str, ...]) -> str:
    """The compiler's version and what it knows of this processor."""
    try:
        told = subprocess.run(
            [*compiler, "-march=native", "-dM", "-E", "-x", "c", os.devnull],
            check=True, capture_output=True, text=True, timeout=LONGEST_BUILD,
        ).stdout  # fmt: skip
    except (OSError, subprocess.SubprocessError) as error:
        raise NoCompiler(f"{compiler[0]} fails: {error}") from error
    return "\0".join((*compiler, platform.machine(), told))
