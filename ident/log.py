"""A measured record of a platform in motion: one table in SI units and paper signs.

Frames: body X forward, Y left, yaw counter-clockwise; a positive wheel velocity or torque drives
the robot forward.
"""

from __future__ import annotations

import hashlib
import io
import itertools
import os
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ident.doctor import Finding, LogError, check_accepted, examine
from ident.loaders import damage_told, find_loader, read
from ident.memo import Memo
from youbot_env.channels import channel_columns
from youbot_env.effects import effect_names, get_effect
from youbot_env.model_file import write_atomically
from youbot_env.platform import Platform, youbot
from youbot_env.platform_file import GivenPlatform, read_platform
from youbot_env.shipped import Shipped


def parse_declaration(items: Iterable[str], platform: Platform) -> dict[str, dict[str, float]]:
    """Turn ``EFFECT=VALUE`` and ``EFFECT.PARAMETER=VALUE`` into sensor effects with their values.

    What is not stated of an effect is nothing.

    Raises:
        ValueError: no sensor effect, no value, or one that cannot be.
    """
    found: dict[str, dict[str, float]] = {}
    for item in items:
        place, given, text = (part.strip() for part in item.partition("="))
        name, _, parameter = place.partition(".")
        sensors = [n for n in effect_names() if get_effect(n).link == "sensor"]
        if name not in sensors:
            raise ValueError(f"recording {item!r}: {name!r} is none of {', '.join(sensors)}")
        effect = get_effect(name)
        if not (given and text):
            raise ValueError(f"recording {item!r}: write {place}=VALUE")
        parameter = parameter or effect.parameters[0].name
        values = found.setdefault(name, {p.name: 0.0 for p in effect.parameters})
        value: float | str = text
        if text not in effect.parameter_of(parameter).choices:
            try:
                value = float(text)
            except ValueError:
                words = ", ".join(effect.parameter_of(parameter).choices)
                remedy = f"choose {words}" if words else "give a number, with a decimal point"
                raise ValueError(f"recording {item!r}: {text!r}; {remedy}") from None
        values[parameter] = effect.complete({**values, parameter: value}, platform)[parameter]
    return found


CHANNELS = (
    "wheel_velocity",
    "body_velocity",
    "wheel_torque",
    "wheel_voltage",
    "reference",
    "pose",
    "battery_voltage",
    "wheel_angle",
)

BUNDLED = Shipped(Path(__file__).parent / "logs", ".csv", ("logs",))
# Said of a log that looks like one of another robot, of which no wheel table is known.
GIVE_TABLE = (
    "give its own, --platform 'R=.. r=.. l=.. h=..' or a file (docs/add_a_platform.md), or its "
    "lever l + h with --lever"
)
YOUBOT_TABLE = "looks like a log of another robot, and is read with the youBot's wheel table"

# Those that a file may hold.
FILED = tuple(channel for channel in CHANNELS if channel != "wheel_angle")


@dataclass(frozen=True, eq=False)
class Log:
    """A measured record with N samples of a platform with n wheels.

    Attributes:
        name: shown in tables; the stem of the file.
        platform: wheel table; its wheel names end the column names.
        time: (N,) s, strictly rising, starting anywhere.
        wheel_velocity: (N, n) rad/s, or None.
        body_velocity: (N, 3) V_X, V_Y m/s, Omega rad/s, measured independently of the wheels, or
            None.
        wheel_torque: (N, n) N m, or None.
        wheel_voltage: (N, n) V, or None.
        reference: (N, 3) commanded body velocity, m/s, m/s, rad/s, or None.
        pose: (N, 3) x, y m, yaw rad (without jumps), world frame, or None.
        battery_voltage: (N,) V, or None.
        wheel_angle: (N, n) rad from the start of the record, where it was integrated before the
            log was cut or decimated; files have none.
        drive_noise: (n,) standard deviations of the white noise of the drive's rows where the rows
            are means of what was logged, which hides it; None where they can tell themselves.
        speed_noise: (n,) the same of wheel speeds that a filter was taken out of.
        starts: samples at which a contiguous piece begins, the first being 0.
        findings: what the doctor noticed.
        accepted: names of the findings that the user accepted, of those that were there.
        recording: declared sensor effects with their values, by identifier; how a row came to be
            is then taken as given.
        digest: SHA-256 of the file in hexadecimal digits; empty for a log not read from a file.
        source: name of the file.
        runs: name of each record that the log was joined from, and the time at which it begins, s;
            empty where it is one record.
        window: length of the windows in which simulations of it are judged, s; by its duration
            where None.
        held: whether pose and wheel angles were known before the log was cut, so that they hold
            through its gaps.
    """

    name: str
    platform: Platform
    time: np.ndarray
    wheel_velocity: np.ndarray | None = None
    body_velocity: np.ndarray | None = None
    wheel_torque: np.ndarray | None = None
    wheel_voltage: np.ndarray | None = None
    reference: np.ndarray | None = None
    pose: np.ndarray | None = None
    battery_voltage: np.ndarray | None = None
    wheel_angle: np.ndarray | None = None
    drive_noise: np.ndarray | None = None
    speed_noise: np.ndarray | None = None
    starts: tuple[int, ...] = (0,)
    findings: tuple[Finding, ...] = ()
    accepted: tuple[str, ...] = ()
    recording: dict[str, dict[str, float]] = field(default_factory=dict)
    digest: str = ""
    source: str = ""
    runs: tuple[tuple[str, float], ...] = ()
    window: float | None = None
    held: bool = False

    def __post_init__(self) -> None:
        count, wheels = len(self.time), len(self.platform.wheels)
        shapes: dict[str, tuple[int, ...]] = dict.fromkeys(CHANNELS, (count, 3))
        shapes |= dict.fromkeys([c for c in CHANNELS if c.startswith("wheel")], (count, wheels))
        shapes |= {"battery_voltage": (count,), "time": (count,)}
        for channel, shape in shapes.items():
            value = getattr(self, channel)
            if value is None:
                continue
            frozen = isinstance(value, np.ndarray) and not value.flags.writeable
            array = value if frozen and value.dtype == float else np.array(value, float)
            if array.shape != shape:
                raise ValueError(
                    f"log {self.name!r}: {channel} has shape {array.shape}, it needs {shape}"
                )
            array.flags.writeable = False
            object.__setattr__(self, channel, array)
        if self.wheel_velocity is None and self.body_velocity is None:
            raise ValueError(f"log {self.name!r} has no velocities; give wheels' or body's")

    @classmethod
    def load(
        cls,
        path: str | os.PathLike,
        platform: Platform | GivenPlatform | str | None = None,
        mapping: dict[str, str] | None = None,
        kt: float | None = None,
        gear: float | None = None,
        strict: bool = False,
        recording: Iterable[str] = (),
        accept: Iterable[str] = (),
        lever: float | None = None,
        most_rows: int | None = None,
    ) -> Log:
        """Read a log of any known format; every one passes the doctor.

        Args:
            path: file or folder, or the name of a bundled log (``youbot_fit``, ``youbot_test``).
            platform: wheel table, or what ``read_platform`` takes (a YAML file, a line, a name),
                which may also say how its logs are read; if left that which the file names, else
                the youBot's.
            mapping: ``{log name: column}`` for foreign headers.  A column may carry a minus and a
                unit: ``{"wheel_velocity_fl": "-left_front [rpm]"}``.
            kt: torque constant of a motor, N m/A, where the log holds currents.
            gear: motor turns per wheel turn, where the log holds currents.
            strict: refuse warnings as well.
            recording: what is known of how the log was recorded, ``EFFECT=VALUE`` each
                (``drive_hold=held``); it goes before what the file declares.
            accept: names of findings that are no reason to refuse the log.
            lever: l + h, m, where it is not that of the wheel table, which is scaled to it.
            most_rows: of a CSV or Parquet file with more rows so many are read, those in which most
                happens, and a finding says so; all of them if left.

        Raises:
            LogError: the log cannot be used; the message names row, column, value and remedy.
            ValueError: a name to accept is none.
        """
        accept = check_accepted(accept)
        path = find_log(path)
        given = read_platform(platform) if isinstance(platform, str) else platform
        given = GivenPlatform(given) if isinstance(given, Platform) else given
        loader = find_loader(path)  # nothing that is no log, a folder of anything, is hashed
        with ThreadPoolExecutor(1) as pool:  # hashing a large file takes as long as reading it
            digest = pool.submit(_digest, path)
            table = read(path, youbot() if given is None else given.platform, loader, most_rows)
            unknown = given is None and table.platform is None and lever is None
            given = given or GivenPlatform(table.platform or youbot())
            if lever is not None:
                given = replace(given, platform=given.platform.with_lever(lever))
            table.usual = given.mapping
            kt, gear = kt or given.kt, gear or given.gear
            accepted = (*table.accept, *accept)
            with damage_told(path, "columns of a kind that cannot be worked with"):
                record = examine(table, path.name, given.platform, mapping, kt, gear, accepted)
        platform = given.platform
        if unknown and "wheel_duty" in record.channels:
            table.foreign = table.foreign or record.name("wheel_duty")
        if unknown and table.foreign:
            record.warn("platform", YOUBOT_TABLE, table.foreign, GIVE_TABLE)
        anew = {finding.what for finding in record.findings}
        findings = (*(f for f in table.recalled if f.what not in anew), *record.findings)
        if strict and any(finding.severity == "warning" for finding in findings):
            raise LogError(path.name, [f for f in findings if f.severity == "warning"])
        try:
            stated = parse_declaration([*table.recording, *recording], platform)
        except ValueError as error:
            remedy = "see the sensor effects in docs/effects.md"
            raise LogError(path.name, [Finding("error", str(error), "header", remedy)]) from error
        values: dict[str, Any] = {channel: record.get(channel) for channel in FILED}
        if values["battery_voltage"] is not None:
            values["battery_voltage"] = values["battery_voltage"][:, 0]
        if values["pose"] is not None:
            values["pose"][:, 2] = np.unwrap(values["pose"][:, 2])
        return cls(
            name=path.stem,
            platform=platform,
            time=record.time,
            **values,
            starts=(0, *(np.flatnonzero(record.breaks[1:]) + 1).tolist()),
            findings=findings,
            accepted=record.accepted,
            recording=stated,
            digest=digest.result(),
            source=path.name,
        )

    @cached_property
    def memo(self) -> Memo:
        """What was computed from the log last."""
        return Memo()

    @property
    def dt(self) -> float:
        """Median sample time, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def duration(self) -> float:
        """Time from first to last sample, s; of all runs together, less what lies between them."""
        first = np.searchsorted(self.time, [begin for _, begin in self.runs[1:]])
        between = np.sum(self.time[first] - self.time[first - 1]) if len(first) else 0.0
        return float(self.time[-1] - self.time[0] - between)

    @property
    def cut(self) -> bool:
        """Whether it holds stretches of a longer record, see ``ident.excerpt``."""
        return any(finding.name == "excerpt" for finding in self.findings)

    @property
    def drive(self) -> str:
        """What drives the wheels: ``"torque"`` or ``"voltage"``.

        Raises:
            ValueError: the log has neither.
        """
        if self.wheel_torque is not None:
            return "torque"
        if self.wheel_voltage is not None:
            return "voltage"
        raise ValueError(
            f"log {self.name!r} has neither wheel torques nor voltages; record wheel_torque_* or "
            "wheel_voltage_*"
        )

    @property
    def command(self) -> np.ndarray:
        """(N, n) drive input: torques, N m, or voltages, V."""
        command = self.wheel_torque if self.drive == "torque" else self.wheel_voltage
        assert command is not None  # drive says so
        return command

    def velocity(self) -> np.ndarray:
        """(N, 3) body velocities, m/s, m/s, rad/s.

        The independent measurement where there is one, else least squares from the wheel speeds.
        """
        if self.body_velocity is not None:
            return self.body_velocity
        return self.wheel_velocity @ np.linalg.pinv(self.platform.jacobian_array).T

    @property
    def spans(self) -> list[tuple[int, int]]:
        """First sample of each contiguous piece, and the one after its last."""
        return list(itertools.pairwise([*self.starts, len(self.time)]))

    def pieces(self) -> list[Log]:
        """Contiguous pieces, in order; the log itself where it has no gap."""
        if len(self.spans) == 1:
            return [self]
        return [self._rows(slice(*s), f"{self.name}#{k}") for k, s in enumerate(self.spans, 1)]

    def run_of(self, time: np.ndarray) -> np.ndarray:
        """Numbers of the runs in which times, s in the log's own time, lie."""
        return np.searchsorted([begin for _, begin in self.runs[1:]], time, side="right")

    def run_name(self, number: int) -> str:
        """Name of a run; of the log where it is one record."""
        return self.runs[number][0] if self.runs else self.name

    @property
    def run_names(self) -> list[str]:
        """Names of all runs; that of the log alone where it is one record."""
        return [name for name, _ in self.runs] or [self.name]

    def without_runs(self, names: set[str]) -> Log:
        """The record without some of the runs that it was joined from; at least one is left."""
        ends = [*(begin for _, begin in self.runs[1:]), np.inf]
        kept = [self.part(begin, end) for (name, begin), end in zip(self.runs, ends, strict=True)
                if name not in names]  # fmt: skip
        values, starts, rows = {}, [], 0
        for part in kept:
            starts += [start + rows for start in part.starts]
            rows += len(part.time)
        for channel in ("time", *CHANNELS):
            if getattr(self, channel) is not None:
                values[channel] = np.concatenate([getattr(part, channel) for part in kept])
        runs = tuple(run for run in self.runs if run[0] not in names)
        more = f" and {len(runs) - 1} more" if len(runs) > 1 else ""
        return replace(self, **values, starts=tuple(starts), runs=runs, name=runs[0][0] + more)

    def part(self, t0: float, t1: float) -> Log:
        """Samples with ``t0 <= time < t1``, s, in the log's own time.

        Raises:
            ValueError: fewer than two samples lie there.
        """
        a, b = np.searchsorted(self.time, [t0, t1])
        if b - a < 2:
            raise ValueError(
                f"log {self.name!r} has {b - a} samples from {t0} to {t1} s; it runs from "
                f"{self.time[0]:.6g} to {self.time[-1]:.6g} s"
            )
        return self._rows(slice(int(a), int(b)), self.name)

    def _rows(self, rows: slice, name: str) -> Log:
        values = {channel: getattr(self, channel) for channel in ("time", *CHANNELS)}
        cut: dict[str, Any] = {
            channel: None if v is None else v[rows] for channel, v in values.items()
        }
        # Found by halving: pieces of many runs would else take the square of their number.
        first = bisect_right(self.starts, rows.start)
        inside = self.starts[first : bisect_left(self.starts, rows.stop)]
        begin, end = map(int, self.run_of(cut["time"][[0, -1]]))
        runs = self.runs[begin : end + 1]
        starts = (0, *(start - rows.start for start in inside))
        return replace(self, **cut, name=name, starts=starts, runs=runs)

    def save(self, path: str | Path, remembered: Mapping[str, str] | None = None) -> Path:
        """Write the log as CSV, or as Parquet by the name's ending, and return the path.

        Args:
            path: written whole or not at all.
            remembered: what the file says of itself, by ``ident.remembered.remember``.
        """
        import polars as pl

        columns = {"time": self.time}
        for channel, names in channel_columns(self.platform).items():
            value = getattr(self, channel) if channel in FILED else None
            if value is not None:
                columns |= dict(zip(names, value.reshape(len(value), -1).T, strict=True))
        frame, said = pl.DataFrame(columns), dict(remembered or {})
        if Path(path).suffix.lower() == ".parquet":
            buffer = io.BytesIO()
            frame.write_parquet(buffer, metadata=said)
            return write_atomically(path, buffer.getvalue())
        head = "".join(f"# {name}: {text}\n" for name, text in said.items())
        return write_atomically(path, (head + frame.write_csv()).encode("utf-8"))

    def __repr__(self) -> str:
        there = [field.name for field in fields(self) if field.name in CHANNELS]
        there = ", ".join(name for name in there if getattr(self, name) is not None)
        return (
            f"Log({self.name!r}, {len(self.time)} samples, {self.duration:.4g} s, "
            f"{1 / self.dt:.4g} Hz: {there})"
        )


def find_log(source: str | os.PathLike) -> Path:
    """Return the path that is given, or that of the log which a name means.

    See ``youbot_env.shipped``; a folder that is there is a log of several files.
    """
    path = Path(source)
    return path if path.exists() else BUNDLED.find(path) or path


def _digest(path: Path) -> str:
    """SHA-256 of a file, or of the names and contents of all files of a folder."""
    digest = hashlib.sha256()
    for file in [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file()):
        if path.is_dir():
            digest.update(file.relative_to(path).as_posix().encode())
        with file.open("rb") as stream:
            while block := stream.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()
