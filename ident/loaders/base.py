"""What a loader is: one class that recognises a format and reads it into a table of columns."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from ident.doctor.finding import Finding, LogError
from ident.doctor.table import Table
from youbot_env.platform import Platform


class Loader:
    """Base class of all loaders.

    Class attributes:
        identifier: short name of the format.
        title: the format in a few words.
        priority: loaders of high priority are asked first; a foreign header before plain CSV.
    """

    identifier: ClassVar[str]
    title: ClassVar[str]
    priority: ClassVar[int] = 0

    def recognises(self, path: Path) -> bool:
        """Tell, from name and first bytes alone, whether ``path`` is of this format."""
        raise NotImplementedError

    def read(self, path: Path, platform: Platform) -> Table:
        """Read the file or folder.

        Raises:
            LogError: it is empty, damaged, or not what its name or first bytes promise.
        """
        raise NotImplementedError

    def read_excerpt(self, path: Path, platform: Platform, most_rows: int) -> Table:
        """Read the liveliest stretches of a file with more rows, see ``long_files``.

        Formats that cannot be read in parts are read as a whole.
        """
        return self.read(path, platform)


def refuse(source: str | Path, what: str, where: str, remedy: str) -> LogError:
    """Return the error for a file that cannot be read, ready to be raised."""
    return LogError(Path(source).name, [Finding("error", what, where, remedy)])


def head(path: Path, size: int = 65536) -> bytes:
    """First bytes of a file; nothing of a folder."""
    if not path.is_file():
        return b""
    with path.open("rb") as stream:
        return stream.read(size)
