"""How logs came to be recorded: what a row stands for, and whose clock is late.

Hardly any robot holds its torque from row to row, yet a simulation has to hold something.  What
counts is the lead: the time by which the drive's rows act ahead of being held from their own time
on.  Held rows have none, sampled rows half a row, means over the time before a whole row; a late
clock or a filter adds to it.  The lead is estimated with the robot's parameters, by output error;
which of its causes it has is told by where it lies, since they do the same to a robot.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ident.contradiction import wheels_agree
from ident.doctor.odometry import body_against, pose_against_wheels
from ident.free_values import FreeValues
from ident.input_noise import noisier_speeds
from ident.instruments import (
    HOLD,
    OFFSET,
    SHIFT,
    hold_of,
    lead_of,
    stated,
    stating,
    with_instruments,
    without_instruments,
)
from ident.log import Log
from ident.noise_floor import noise_floor
from ident.output_error import OutputError, refine
from ident.scaled_fit import ScaledFit
from ident.thinning import SEARCHED, thinned
from youbot_env import dynamics
from youbot_env.effects import Effect, get_effect
from youbot_env.measurement import AVERAGED, HELD, HOLDS, SAMPLED
from youbot_env.model import Model

# Leads this close to that of a hold have no other cause, s, or in standard errors: a loop at 1 kHz
# holds its torque for a millisecond, so its samples act half a millisecond late.
CLOSE, SURE = 1e-3, 2.5
# A fit of the lead looks at this much of a log, s; its precision is far below CLOSE by then.
ENOUGH = 120.0
# Wheel speeds that come later than the pose by this much, s, and by so many standard errors, are
# late: simulated robots with rollers and creep stay below a third of it.
LAG, LATE, CERTAIN = "velocity_filter", 2e-3, 4.0
# Angles, rad, places, m, and biases, rad/s, of a body-velocity sensor that are worth a word.
NOTICED = {"angle": 5e-3, "px": 5e-3, "py": 5e-3, "b": 1e-3}
# Half width of a 95 % interval in standard errors.
WIDE = 2.0
# Of what a model leaves unexplained this share may lie along the trace of a lead, where the wheels
# agree with each other and where they do not: leads of simulated robots with effects that no
# nuisance stands for (payload, sag, a patch of floor; slip, real rollers) were wrong by as much.
ALIGNED = (0.1, 0.3)
# Share of what was known beforehand to which the error of a known clock has come down.
KNOWN = 0.25
# Least standard deviation of what is known of a lead beforehand, s.
LEAST_SPREAD = 0.01
# Half widths beyond which a clock is not known, s.
VAGUE = 8e-3
# Free-run errors remember each other for about this time, s.
MEMORY = 0.3
# A step of a robot that lowers the squares by less than this share leaves it where it is, before
# its clock is looked for.
ROUGHLY = 1e-3
# Effects that are fitted beside a lead so that it need not stand for them; those with a value for
# each wheel even where one would do.
NUISANCES = (
    "wheel_coulomb_friction",
    "roller_coulomb_friction",
    "floor_slope",
    "torque_gain",
    "torque_offset",
    "wheel_radius_error",
)
EACH_WHEEL = ("torque_offset",)
WEAK = 1e-6
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


@dataclass(frozen=True, eq=False)
class Recording:
    """A log with what was found of its recording.

    Attributes:
        original: the log as it was read.
        log: states hold and clock; laws and fits then see its robot.
        lead: time by which its rows act ahead of held ones, s.
        error: standard error of that; zero where it was declared.
        witnessed: what other instruments of the log say about those of its velocities.
    """

    original: Log
    log: Log
    lead: float
    error: float
    witnessed: tuple[Instrument, ...] = ()

    @property
    def instruments(self) -> tuple[Instrument, ...]:
        """The same for people and programs."""
        return (*clock(self.original, self.lead, self.error), *self.others)

    @property
    def others(self) -> tuple[Instrument, ...]:
        """What is known beyond hold and clock of the drive."""
        return (*declared(self.original), *self.witnessed)

    @property
    def known(self) -> bool:
        """Whether the clock is known well enough not to be taken for a late robot."""
        return self.error <= KNOWN * max(self.original.dt, LEAST_SPREAD)

    def moved_from(self, other: Recording) -> bool:
        """Whether the clock is known now and another than it was."""
        return self.known and abs(self.lead - other.lead) > CLOSE

    def moved(self) -> Log:
        """The log as it would be with a lead one standard error larger."""
        return stating(self.log, OFFSET, d=self.log.recording[OFFSET]["d"] + self.error)


def find_recordings(logs: list[Log], model: Model, signed: bool = True) -> list[Recording]:
    """Estimate what every log needs of the measurement model.

    Args:
        logs: records of one robot, with a drive input.
        model: start values of the robot, and effects that are known.
        signed: whether a robot that answers late is put down to the clock.  Where it is not, rows
            are taken to be sampled on the clock of the velocities there, and what is late is left
            to be explained.
    """
    if all(HOLD in log.recording and OFFSET in log.recording for log in logs):
        return [_recording(log, 0.0, 0.0, signed) for log in logs]
    told = [_by_pose(log) for log in logs]
    found = _find_clocks([log for log, _ in told], model, signed)
    return [
        replace(record, original=log, witnessed=said)
        for record, log, (_, said) in zip(found, logs, told, strict=True)
    ]


def _by_pose(log: Log) -> tuple[Log, tuple[Instrument, ...]]:
    """The log with what its pose says about the lateness of its wheel speeds stated.

    A pose shows what has happened and is never early: against it speeds can only be too late.
    Where the pose is late itself nothing is said.
    """
    if log.body_velocity is not None:
        return _body_sensor(log)
    shown = log.pose is not None and log.wheel_velocity is not None
    if not shown or LAG in log.recording:
        return log, ()
    seen = pose_against_wheels(log)
    if seen is None or not seen.shift.known or seen.shift.se > LATE:
        return log, ()
    late, half = -seen.shift.value, WIDE * seen.shift.se
    if late < -LATE:
        return log, ()
    if late < max(LATE, CERTAIN * seen.shift.se):
        return stating(log, LAG, T=0.0), ()
    words = (
        f"wheel speeds come {1e3 * late:.3g} ms +- {1e3 * half:.2g} ms later than the pose: a "
        "filter with that time constant, or means over twice that time"
    )
    said = Instrument(LAG, "T", late, "s", (late - half, late + half), "estimated", log.name, words)
    return stating(log, LAG, T=late), (said,)


def _body_sensor(log: Log) -> tuple[Log, tuple[Instrument, ...]]:
    """The log with mounting and bias of its body-velocity sensor, as its wheels or pose show them.

    Kinematics show them whatever forces act; what they leave open diagnosis looks for.
    """
    # Rollers and slip stand between the wheels and the motion, nothing between it and a pose.
    source = "wheels" if log.pose is None else "pose"
    if source == "wheels" and log.wheel_velocity is None:
        return log, ()
    seen = body_against(log, source)
    if seen is None:
        return log, ()
    # Of the wheels against the sensor, and of the sensor against the pose, signs are opposite.
    sign = -1.0 if source == "wheels" else 1.0
    values = {
        ("sensor_mounting", "angle"): (seen.angle, sign),
        ("sensor_mounting", "px"): (seen.lever_x, -sign),
        ("sensor_mounting", "py"): (seen.lever_y, -sign),
        ("gyro_bias", "b"): (seen.bias, -sign),
    }
    told, declared_before = [], set(log.recording)
    for (name, flat), (estimate, turn) in values.items():
        effect = get_effect(name)
        if name in declared_before:
            continue
        least = NOTICED[flat]
        if not estimate.known or abs(estimate.value) < max(least, CERTAIN * estimate.se):
            continue
        stated = log.recording.get(name, {p.name: 0.0 for p in effect.parameters})
        log = stating(log, name, **{**stated, flat: turn * estimate.value})
        told.append(plain(log, effect, flat, turn * estimate.value, estimate.se))
    return log, tuple(told)


def _find_clocks(logs: list[Log], model: Model, signed: bool) -> list[Recording]:
    """Hold and clock of the drive of every log."""
    sparse = [sparsely(exciting(log)) for log in logs]
    rich = _with_nuisances(with_instruments(without_instruments(model), sparse))
    try:
        # First the robot with the clocks that rows usually have: from a robot that is far from true
        # a slow motion leads to clocks of 50 ms, where it is as well explained and wrong.
        usual = [_usual_clock(log, rich, raw) for log, raw in zip(sparse, logs, strict=True)]
        first = refine(usual, rich, tolerance=ROUGHLY, smooth=True, intervals=False)
        fit = refine(sparse, first.model, smooth=True, draws=1)
    except ValueError:  # no window is contiguous: the recording stays what it usually is
        return [_recording(log, lead_of(SAMPLED, log.dt), 0.0, signed) for log in logs]
    found = []
    for number, log in enumerate(logs):
        ahead, error = lead(fit, number)
        pull = _pull_of_loops(fit, number, log)
        found.append((ahead - pull, float(np.hypot(error, pull))))
    return [_recording(log, *one, signed) for log, one in zip(logs, found, strict=True)]


def _usual_clock(sparse: Log, model: Model, raw: Log) -> Log:
    """A log that states the clock of sampled rows, if it states none."""
    if OFFSET in sparse.recording:
        return sparse
    return stating(
        sparse, OFFSET, d=lead_of(SAMPLED, raw.dt) - lead_of(hold_of(sparse, model), raw.dt)
    )


def _pull_of_loops(fit: OutputError, number: int, log: Log) -> float:
    """How far the noise that wheel loops answer to may pull a lead, s.

    As much noise once more, in speeds and in torques as the loops answer to it, pulls as far again:
    back where rows show instants, hardly where they are held and the robot felt it.  Which they do
    is not known by then, so all of what is taken back stays in the error.
    """
    model = fit.models[number]
    if SHIFT in stated(model, log):
        return 0.0
    at = model.names().index(SHIFT)
    free = FreeValues.of(model, None, None, [set(stated(model, log))])
    steps = [
        ScaledFit.at([sparsely(one)], [model], None, smooth=True).step(free, 0.0)[0][at]
        for one in (exciting(log), *noisier_speeds(exciting(log)))
    ]
    return float(np.mean(steps[1:]) - steps[0])


def with_free_clocks(
    records: list[Recording], model: Model
) -> tuple[list[Log], Model, list[dict[str, tuple[float, float]]]]:
    """Logs whose clocks are to be fitted with the robot, from what was found of them.

    Returns:
        The logs; the model with the clock of the first; and for each log between which values its
        clock may move: where it was found, give or take its error.
    """
    logs, ends = [], []
    for record in records:
        stated, end = dict(record.log.recording), {}
        if record.error:
            found = stated.pop(OFFSET)["d"]
            half = max(CLOSE, SURE * record.error)
            end[SHIFT] = found - half, found + half
        logs.append(replace(record.log, recording=stated))
        ends.append(end)
    model = with_instruments(model, logs)
    first = records[0].log.recording
    return logs, model.with_effects({name: first[name] for name in (HOLD, OFFSET)}), ends


def _with_nuisances(model: Model) -> Model:
    """The model with common effects that it does not have, at nothing, to be fitted beside it.

    A lead is the slope of a phase, and any friction or force that is missing turns phases: on its
    own the robot's seven parameters make up for that by leads of up to 60 ms.
    """
    present = {active.identifier for active in model.effects}
    added = {}
    for name in NUISANCES:
        if name not in present:
            effect = get_effect(name)
            split = any(p.per_wheel and p.contrast for p in effect.parameters) or name in EACH_WHEEL
            added[name] = dict.fromkeys(effect.parameter_names(model.platform, split), 0.0)
    return model.with_effects(added)


def sparsely(log: Log) -> Log:
    """The log, or means over 20 ms where it is denser; these act as held torques do."""
    thin = thinned(log, SEARCHED)
    return log if thin is log else stating(thin, HOLD, kind=float(HOLDS.index(HELD)))


def lead(fit: OutputError, number: int) -> tuple[float, float]:
    """Time by which a log's rows act ahead of held ones, and its standard error, s.

    Besides the scatter between windows the error holds what the model leaves unexplained, a share
    of which may lie along the trace of the lead.
    """
    model, at = fit.models[number], fit.scopes.names.index(SHIFT)
    sim = fit.simulations[number]
    ahead = model.values()[at] + lead_of(hold_of(sim.raw, model), sim.raw.dt)
    if SHIFT in stated(model, sim.raw):
        return ahead, 0.0
    ahead -= _flattened(model, sim.raw.dt)
    scaled = ScaledFit.at([sim.raw], [model], None)
    free = FreeValues.of(model, None, None, [set(stated(model, sim.raw))])
    columns = scaled.columns(free) @ free.directions[free.moving]
    place = fit.scopes.index[number, at]
    trace = scaled.columns(free)[:, np.flatnonzero(free.moving).searchsorted(at)]
    others = columns[:, free.directions[at] == 0]
    scale = np.maximum(np.linalg.norm(others, axis=0), 1e-300)
    alone = trace - others @ (np.linalg.lstsq(others / scale, trace, rcond=WEAK)[0] / scale)
    floor = noise_floor(sim, scaled.weights[0])[0]
    left = max(2 * scaled.cost - len(scaled.error) * floor, 0.0)
    share = ALIGNED[0 if wheels_agree(sim.log) else 1]
    size = max(float(np.linalg.norm(alone)), 1e-300)
    # Few windows may agree by chance; errors that remember each other for a while set a limit.
    memory = np.sqrt(max(MEMORY / sim.log.dt, 1.0)) * np.sqrt(2 * scaled.cost / len(scaled.error))
    scatter = max(float(np.sqrt(fit.covariance[place, place])), memory / size)
    return ahead, float(np.hypot(scatter, share * np.sqrt(left) / size))


def _flattened(model: Model, dt: float) -> float:
    """Lead that a fit makes up because torques are held through a row, s.

    Of a torque that rises within a row more comes late, when less of it has faded by the row's end,
    than of its mean: to first order as if it came earlier by dt^2 / 12 times the rate of fading.
    """
    inertia = dynamics.prepare(model.platform.geometry, model.parameters.theta(model.platform))
    units = np.eye(3).tolist()
    rates = [-dynamics.acceleration(inertia, tuple(e), (0.0,) * 3)[k] for k, e in enumerate(units)]
    return float(np.mean(rates)) * dt**2 / 12


def _recording(log: Log, ahead: float, error: float, signed: bool) -> Recording:
    """What a fit to (means of) a log says of the log itself."""
    kind = log.recording.get(HOLD, {}).get("kind")
    hold = SAMPLED if kind is None else HOLDS[round(kind)]
    if OFFSET in log.recording:
        ahead, error = log.recording[OFFSET]["d"] + lead_of(hold, log.dt), 0.0
    else:
        # Known beforehand: rows act about half a row ahead, give or take a row, or as the hold that
        # was declared; unless they certainly do not.
        before = 0.5 * log.dt if kind is None else lead_of(hold, log.dt)
        spread = max(log.dt, LEAST_SPREAD)
        if abs(ahead - before) < spread + SURE * error:
            ahead = (ahead * spread**2 + before * error**2) / (spread**2 + error**2)
            error = error * spread / float(np.hypot(spread, error))
        earliest = 0.0 if kind is None else before
        if not signed:
            # Where the robot is late, or might as well be, rows count as what they usually are.
            late = earliest - ahead > max(CLOSE, SURE * error)
            ahead = before if late or error > 0.5 * spread else max(ahead, earliest)
            if late:  # whose fault that is nobody knows, nor then what a row stands for
                error = max(error, 0.5 * before)
    said = clock(log, ahead, error)
    hold = float(HOLDS.index(said[0].value))
    told = stating(stating(log, HOLD, kind=hold), OFFSET, d=float(said[1].value))
    return Recording(log, told, ahead, error)


def exciting(log: Log) -> Log:
    """The log, or where it is long the stretch of ``ENOUGH`` seconds in which it moves most."""
    if log.duration <= ENOUGH:
        return log
    speed = np.abs(np.gradient(log.velocity(), log.time, axis=0)) / log.velocity().std(axis=0)
    total = np.concatenate([[0.0], np.cumsum(speed.sum(axis=1) * np.gradient(log.time))])
    ends = np.searchsorted(log.time, log.time + ENOUGH)
    inside = log.time + ENOUGH <= log.time[-1]
    start = int(np.argmax(np.where(inside, total[np.minimum(ends, len(log.time))] - total[:-1], 0)))
    return log.part(log.time[start], log.time[start] + ENOUGH)


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
