"""What was found of a recording, for people and programs: one thing each, with a sentence."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ident.instruments import HOLD, OFFSET, lead_of
from ident.log import Log
from youbot_env.effects import Effect, get_effect
from youbot_env.measurement import AVERAGED, HELD, HOLDS, SAMPLED

# Leads this close to that of a hold have no other cause, s, or in standard errors: a loop at 1 kHz
# holds its torque for a millisecond, so its samples act half a millisecond late.
CLOSE, SURE = 1e-3, 2.5
# Half width of a 95 % interval in standard errors.
WIDE = 2.0
# Half widths beyond which a clock is not known, s.
VAGUE = 8e-3
ROWS = {
    HELD: "each row of the drive is held until the next",
    SAMPLED: "rows of the drive are sampled",
    AVERAGED: "rows of the drive are means over the time before",
}


@dataclass(frozen=True)
class Instrument:
    """One thing about the recording.

    Attributes:
        what: identifier of the sensor effect.
        parameter, unit: what the value is of.
        value: number, or word of a choice.
        ci95: 95 % interval; None where it was given or assumed.
        status: ``declared`` by the log, ``estimated`` from it, or ``assumed``.
        log: name of the log.
        words: a sentence.
        alike: sensor effects that would do the same.
    """

    what: str
    parameter: str
    value: float | str
    unit: str
    ci95: tuple[float, float] | None
    status: str
    log: str
    words: str
    alike: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON shows."""
        return {
            "what": self.what,
            "parameter": self.parameter,
            "value": self.value,
            "unit": self.unit,
            "ci95": None if self.ci95 is None else list(self.ci95),
            "status": self.status,
            "log": self.log,
            "alike": list(self.alike),
            "words": self.words,
        }


def nearest_hold(lead: float, error: float, dt: float) -> tuple[str, bool]:
    """The hold that a lead speaks for, and whether it alone explains it.

    Where none does the rows count as sampled, as most are.
    """
    tolerance = max(CLOSE, SURE * error)
    hold = min(HOLDS, key=lambda one: abs(lead - lead_of(one, dt)))
    alone = abs(lead - lead_of(hold, dt)) <= tolerance
    return (hold if alone else SAMPLED), alone


def clock(log: Log, ahead: float, error: float) -> tuple[Instrument, Instrument]:
    """Hold and offset of the drive's rows.

    Args:
        log: what it states was declared.
        ahead: time by which its rows act ahead of held ones, s.
        error: standard error of that.
    """
    if HOLD in log.recording:
        hold, alone = HOLDS[round(log.recording[HOLD]["kind"])], False
    else:
        hold, alone = nearest_hold(ahead, error, log.dt)
    offset, half = ahead - lead_of(hold, log.dt), WIDE * error
    sure = alone and SURE * error < 0.25 * log.dt
    kind = "declared" if HOLD in log.recording else "estimated" if sure else "assumed"
    said = Instrument(HOLD, "kind", hold, "", None, kind, log.name, f"{ROWS[hold]} ({kind})")
    interval = (offset - half, offset + half) if error > 0 else None
    status = "declared" if OFFSET in log.recording else "estimated" if error > 0 else "assumed"
    words, alike = _lateness(offset, half, alone, 0 <= ahead <= log.dt, status)
    return said, Instrument(OFFSET, "d", offset, "s", interval, status, log.name, words, alike)


def declared(log: Log) -> list[Instrument]:
    """What a log states about its recording beyond hold and clock of the drive."""
    found = []
    for name, values in log.recording.items():
        if name not in (HOLD, OFFSET):
            effect = get_effect(name)
            found += [plain(log, effect, flat, value) for flat, value in values.items()]
    return found


def _lateness(
    offset: float, half: float, alone: bool, inside: bool, status: str
) -> tuple[str, tuple[str, ...]]:
    """Words for an offset of the drive's clock, and what looks like it."""
    size = f"{1e3 * abs(offset):.3g} ms"
    if status == "estimated":
        size += f" +- {1e3 * half:.2g} ms"
    if half > max(VAGUE, 2 * abs(offset)):
        return f"its clock is not known: what is left unexplained may hide {1e3 * half:.2g} ms", ()
    if alone or abs(offset) <= max(CLOSE, half) or inside:
        return f"its clock is that of the velocities within {size}", ()
    if offset > 0:
        return (
            f"it comes {size} late: a late clock, or a filter with that time constant",
            ("drive_filter",),
        )
    return (
        f"the robot answers {size} after its rows: late velocities, an early clock, or a delay or "
        "lag of the drive, which diagnosis looks into",
        ("velocity_filter", "actuator_delay", "actuator_lag"),
    )


def plain(log: Log, effect: Effect, name: str, value: float, error: float = 0.0) -> Instrument:
    """One value of a sensor effect; declared where it has no error."""
    parameter = effect.parameter_of(name)
    half = WIDE * error
    status = "estimated" if error > 0 else "declared"
    interval = (value - half, value + half) if error > 0 else None
    shown = parameter.shown(value)
    words = f"{effect.title.lower()}, {parameter.meaning}: {shown:.4g} {parameter.unit}".rstrip()
    if interval:
        words += f" +- {half:.2g}"
    return Instrument(effect.identifier, name, shown, parameter.unit, interval, status, log.name,
                      words)  # fmt: skip


def in_words(instruments: Iterable[Instrument]) -> list[str]:
    """A sentence for each log about how it was recorded."""
    by_log: dict[str, list[str]] = {}
    for one in instruments:
        by_log.setdefault(one.log, []).append(one.words)
    return [f"{log}: {'; '.join(words)}" for log, words in by_log.items()]
