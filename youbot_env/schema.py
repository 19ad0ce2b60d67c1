"""What files of models, platforms and motions may hold: entries, units and ranges, in one place.

Readers check by it, ``python -m controllers.file_tables`` prints docs/files.md from it.  Ranges are
far beyond any robot that rolls on a floor: they keep slips of the pen and damaged files out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from youbot_env.parameters import MEANING, UNITS


@dataclass(frozen=True)
class Entry:
    """One entry of a file.

    Attributes:
        name: key.
        meaning: in words.
        unit: of a number; empty for none.
        low, high: smallest and largest number, both allowed; None for entries that are no numbers.
        needed: whether a file without it is refused.
    """

    name: str
    meaning: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    needed: bool = False

    def check(self, value: float, place: str) -> float:
        """Return a number within the range.

        Raises:
            ValueError: names the place, the number and the range.
        """
        if self.low is None or self.high is None:
            raise TypeError(f"{self.name} is no number")
        if not (math.isfinite(value) and self.low <= value <= self.high):
            raise ValueError(f"{place}{self.name} = {value:g} {self.unit}; give {self.span}")
        return value

    @property
    def span(self) -> str:
        """The range in words."""
        if self.low is None or self.high is None:
            return ""
        return f"{self.low:g} to {self.high:g}{f' {self.unit}' if self.unit else ''}"


@dataclass(frozen=True)
class Section:
    """Entries that stand beside each other.

    Attributes:
        title: where they stand, for people.
        entries: all that there may be.
    """

    title: str
    entries: tuple[Entry, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all entries."""
        return tuple(entry.name for entry in self.entries)

    @property
    def needed(self) -> tuple[str, ...]:
        """Names of those that a file must have."""
        return tuple(entry.name for entry in self.entries if entry.needed)

    def __getitem__(self, name: str) -> Entry:
        return next(entry for entry in self.entries if entry.name == name)


_RANGES = {
    "m0": (0.0, 1e5), "I0": (0.0, 1e5), "I1": (0.0, 1e3), "a_x": (-100.0, 100.0),
    "a_y": (-100.0, 100.0), "mu1": (0.0, 1e4), "mu2": (0.0, 1e3),
}  # fmt: skip

MODEL = Section("Model file (YAML)", (
    Entry("name", "shown in tables; the name of the file if left"),
    Entry("platform", "a name (youbot, omni3) or the entries below", needed=True),
    Entry("parameters", "all seven of those below", needed=True),
    Entry("effects", "a list of identifiers of [effects](effects.md), or of `identifier` and "
          "`parameters`, whose ranges stand there"),
    Entry("covariance", "of all values: as many rows as values, a matrix that a covariance can be"),
    Entry("provenance", "how the model came about, any entries"),
))  # fmt: skip
PARAMETERS = Section("`parameters`: a number each, or the entries of the next table", tuple(
    Entry(name, meaning, UNITS[name], *_RANGES[name], needed=True)
    for name, meaning in MEANING.items()
))  # fmt: skip
PARAMETER = Section("One parameter", (
    Entry("value", "in the unit of the table above", needed=True),
    Entry("unit", "that unit; another is refused, not converted"),
    Entry("standard_error", "in the same unit", "", 0.0, 1e6),
    Entry("source", "where the value comes from"),
))  # fmt: skip
PLATFORM = Section("`platform`", (
    Entry("name", "of the platform"),
    Entry("wheels", "a list of three or more, each with the entries of the next table",
          needed=True),
    Entry("wheel_radius", "R", "m", 1e-3, 10.0, needed=True),
    Entry("roller_radius", "r, the largest radius of a roller, below R", "m", 1e-4, 10.0,
          needed=True),
    Entry("wheel_mass", "of a wheel with its rollers; 1.4 if left", "kg", 1e-4, 1e4),
))  # fmt: skip
WHEEL = Section("One wheel", (
    Entry("name", "ends the names of its columns; its number if left"),
    Entry("x", "forward of the centre; or `distance`", "m", -100.0, 100.0),
    Entry("y", "left of the centre; or `at_deg`", "m", -100.0, 100.0),
    Entry("distance", "from the centre, in place of x and y", "m", 0.0, 100.0),
    Entry("at_deg", "direction of the wheel seen from the centre", "deg", -3600.0, 3600.0),
    Entry("roller_angle_deg", "of the roller axis from the rolling direction", "deg", -85.0, 85.0),
    Entry("heading_deg", "direction in which it rolls", "deg", -3600.0, 3600.0),
))  # fmt: skip
MOTION = Section("Motion file (YAML)", (
    Entry("kind", "`fourier`", needed=True),
    Entry("purpose", "in a word"),
    Entry("frequency", "base angular frequency w", "rad/s", 1e-3, 1e3, needed=True),
    Entry("speed", "largest speed of the centre, told and not used", "m/s", 0.0, 100.0),
    Entry("x", "a list of [amplitude, phase] for k = 1, 2, ...", needed=True),
    Entry("y", "as many", needed=True),
    Entry("yaw", "as many", needed=True),
    Entry("about", "where it comes from, any entries"),
))  # fmt: skip
SINE = Section("One sine of a motion", (
    Entry("amplitude", "of x and y in m, of yaw in rad", "", -1e3, 1e3),
    Entry("phase", "at time zero", "rad", -1e3, 1e3),
))  # fmt: skip
MOST_SINES = 1000  # of an axis
