"""Files that come with the packages, by name; those of the user go before them.

One rule for models, motions, policies and logs: a file that is there is used.  Else a bare name, or
one in the folder of its kind (``identified``, ``models/identified.yaml``), means the file of that
name in that folder of the working directory, where results go, and then the one in the package.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Shipped:
    """Files of one kind.

    Attributes:
        folder: where they lie in the package.
        ending: of their names, with its point.
        places: relative folders, written with slashes, that mean this kind before a name; those of
            the user are looked for in the first.
    """

    folder: Path
    ending: str
    places: tuple[str, ...]

    def find(self, source: str | os.PathLike) -> Path | None:
        """Return the file that a path or a name means; None where there is none."""
        path = Path(source)
        if path.is_file():
            return path
        if path.parent.as_posix() not in (".", *self.places):
            return None
        name = path.name if path.suffix == self.ending else f"{path.name}{self.ending}"
        found = (folder / name for folder in (Path(self.places[0]), self.folder))
        return next((path for path in found if path.is_file()), None)

    def names(self) -> list[str]:
        """Names of the files in the package, sorted."""
        return sorted(path.stem for path in self.folder.glob(f"*{self.ending}"))
