"""Sections of a diagnosis on the error: how it falls, what it depends on, and where it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.comparison import Comparison
from ident.comparison.moments import wheel_torques
from ident.diagnosis.diagnose import Diagnosis
from ident.diagnosis.settings import SETTINGS
from ident.diagnosis.splits import VERIFY, Part
from ident.free_run import FreeRun, free_run
from ident.report import compare_where, motion
from ident.report.compare_where import panels_figure
from ident.report.compare_words import WHERE_HEAD, where_rows
from ident.report.diagnose_figures import error_steps_figure
from ident.report.look import BODY, IDENTIFIED, NOMINAL, WHEELS
from ident.report.outcome import percent
from ident.report.page import Grid, Picture, Section
from ident.sensitivity import window_length
from youbot_env.model import Model

# Time since a reversal that is drawn, s.
RECENT = 1.5
# Oscillations that are looked for in the residual, Hz, as far as a log of that length shows them.
SLOWEST, FASTEST, PERIODS = 0.05, 3.0, 3


def dependence_figure(comparison: Comparison, signals: list[str]) -> bytes | None:
    """Mean of what the equations leave over the signals that it depends on.

    Args:
        comparison: of the model with everything that was added.
        signals: names of ``ident.diagnosis.lack_of_fit``.

    Returns:
        None where the log has none of the signals.
    """
    found = [panel for signal in signals for panel in _panels(comparison, signal)]
    return panels_figure(comparison, found) if found else None


def _panels(comparison: Comparison, signal: str) -> list[tuple]:
    """Panels for ``panels_figure`` of one signal; empty where the log does not have it."""
    m, force = comparison.moments, comparison.force_residual
    leveled = force / (1.0, 1.0, m.platform.lever)
    torque = wheel_torques(comparison.residual, m.platform)

    def body(title: str, values: np.ndarray, span=None) -> tuple:
        return (title, np.repeat(values[:, None], 3, axis=1), leveled, BODY, span)

    def wheels(title: str, values: np.ndarray, span=None) -> tuple:
        return (title, values, torque, WHEELS, span)

    if signal == "forward speed":
        return [body("$V_X$, m/s", m.velocity[:, 0])]
    if signal == "sideways speed":
        return [body("$V_Y$, m/s", m.velocity[:, 1])]
    if signal == "yaw rate":
        return [body("yaw rate, rad/s", m.velocity[:, 2])]
    if signal == "wheel speed":
        return [wheels("wheel speed, rad/s", m.wheel_speed)]
    if signal == "torque":
        kind = "torque, N m" if m.drive == "torque" else "voltage, V"
        return [wheels(f"wheel {kind}", m.command)]
    if signal == "history of the direction":
        since = since_reversal(m.time, m.wheel_speed)
        along = np.where(since <= RECENT, np.sign(m.wheel_speed), 0.0)
        title = "time since the wheel turned round, s"
        return [(title, since, torque * along, WHEELS, (0.0, RECENT))]
    if signal == "wheel angle" and m.wheel_angle is not None:
        angle = np.mod(np.degrees(m.wheel_angle), 360.0)
        return [wheels("wheel angle, deg", angle, (0.0, 360.0))]
    if signal == "heading" and m.pose is not None:
        heading = np.degrees(np.mod(m.pose[:, 2] + np.pi, 2 * np.pi) - np.pi)
        return [body("heading, deg", heading)]
    if signal == "place" and m.pose is not None:
        return [body("x, m", m.pose[:, 0]), body("y, m", m.pose[:, 1])]
    if signal == "time":
        period = strongest_period(m.time, leveled)
        panels = [body("time, s", m.time, (m.time[0], m.time[-1]))]
        if period is not None:
            phase = np.mod(m.time - m.time[0], period)
            title = f"time, folded at {1 / period:.3g} Hz, s"
            panels.append(body(title, phase, (0.0, period)))
        return panels
    return []


def since_reversal(time: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """(N, n) s since each wheel last changed its direction; infinite before it first did."""
    since = np.empty_like(speed)
    for k in range(speed.shape[1]):
        turned = np.append(False, np.diff(np.sign(speed[:, k])) != 0)
        last = np.maximum.accumulate(np.where(turned, time, -np.inf))
        since[:, k] = time - last
    return since


def strongest_period(time: np.ndarray, force: np.ndarray) -> float | None:
    """Period, s, at which residual forces (N, C) oscillate most; None for a short log."""
    from scipy.signal import periodogram

    step = float(np.median(np.diff(time)))
    even = np.arange(time[0], time[-1], step)
    evenly = np.stack([np.interp(even, time, column) for column in force.T], axis=1)
    frequency, power = periodogram(evenly, 1.0 / step, axis=0, detrend="linear")
    slowest = max(SLOWEST, PERIODS / (even[-1] - even[0]))
    inside = (frequency >= slowest) & (frequency <= min(FASTEST, 0.4 / step))
    if not np.any(inside):
        return None
    return float(1.0 / frequency[inside][np.argmax(power.sum(axis=1)[inside])])


FALLING = "The error on held-out windows"
REGIMES, SIGNALS = 10, 3


def ends(found: Diagnosis) -> list[Model]:
    """The base model and, where something was added, the last one, named as on the page."""
    models = [replace(found.base, name="base model")]
    return models + [replace(found.model, name="final model")] * (len(found.chain) > 1)


def falling(found: Diagnosis) -> Section:
    """The error step by step, and the motion behind it."""
    errors = found.errors
    low, high = (percent(end) for end in errors.drop_ci95)
    caption = (
        f"{errors.what.capitalize()}, rms on windows that nothing was fitted to or chosen by, with "
        "each effect that was added."
    )
    if len(errors.nrmse) > 1:
        caption += f" The error falls by {percent(1 - errors.after / errors.before)}, 95 % interval"
        caption += f" {low} ... {high} ({errors.windows} windows)."
    part = max(found.first.parts, key=lambda part: part.windows(VERIFY).sum())
    colors, length = (NOMINAL, IDENTIFIED), window_length(part.log)
    number = found.first.parts.index(part)
    stages = [found.models[0], *found.models[-1:]][: len(ends(found))]
    runs = [
        (shown.name, color, held_out(part, free_run(part.log, own[number], length)))
        for shown, own, color in zip(ends(found), stages, colors, strict=False)
    ]
    seen = (
        f"{part.log.name}: windows that were kept for the end, measured and simulated from the "
        "drive input alone. A line that breaks starts anew at the measured velocity."
    )
    blocks = [
        Picture("error_falling", error_steps_figure(errors), caption),
        Picture("velocities", motion.velocities_figure(runs), seen),
    ]
    return Section(FALLING, blocks)


def held_out(part: Part, run: FreeRun) -> FreeRun:
    """The windows of a run that were kept for the end."""
    rows = part.windows(VERIFY)[run.window]
    return FreeRun(run.time[rows], run.simulated[rows], run.measured[rows], run.window[rows])


def depends_on(found: Diagnosis, compared: list[Comparison]) -> Section:
    """The residual over the signals it depends on, before anything was added and after."""
    before, after = found.first.dependences()[:SIGNALS], list(found.depends_on)
    names = [comparison.model.name for comparison in compared]
    if not before and not after:
        words = _told(" and the ".join(names), after)
    else:
        pairs = zip(names, (before, after)[-len(names) :], strict=True)
        words = " ".join(_told(name, signals) for name, signals in pairs)
    if len(before) > 1 or len(after) > 1:
        words += " Signals that go together in a log share what is behind them."
    blocks: list = []
    signals = [signal for signal, _ in before]
    if len(compared) > 1 and signals:
        # The same signals twice: what was a curve should be flat.
        blocks += _curves("base_depends_on", compared[0], signals)
        signals += [signal for signal, _ in after if signal not in signals]
        blocks += _curves("depends_on", compared[-1], signals, " Each figure has its own scales.")
    elif after:
        blocks += _curves("depends_on", compared[-1], [signal for signal, _ in after])
    return Section("What the error depends on", blocks, words)


def _told(name: str, signals: list[tuple[str, float]]) -> str:
    if not signals:
        return (
            "No signal that was tried (speeds, torque, heading, place, time, wheel angle, history "
            f"of the direction) explains {100 * SETTINGS.least_gain:.0f} % of the error of the "
            f"{name}."
        )
    gains = ", ".join(f"{signal} ({percent(gain)})" for signal, gain in signals)
    return f"Error of the {name}, with the share of its square behind each signal: {gains}."


def _curves(
    stem: str, comparison: Comparison, signals: list[str], remark: str = ""
) -> list[Picture]:
    drawn = dependence_figure(comparison, signals)
    if drawn is None:
        return []
    caption = (
        f"Mean of what the equations of the {comparison.model.name} leave of "
        f"{comparison.log.name}, with 95 % intervals from stretches of time. Over wheel signals: "
        "as torque on that wheel's shaft"
        + (", along its rotation where over time" if "history of the direction" in signals else "")
        + ". Over the others: forces on the body, the moment over the lever L."
    )
    return [Picture(stem, drawn, caption + remark)]


def where(compared: list[Comparison]) -> Section:
    """In which moments the error of the base and of the final model gathers."""
    words = (
        f"The squared equation error on {compared[0].log.name}, divided over kinds of moments. "
        "Filled: more error than time by more than chance, at a false discovery rate of 5 %."
    )
    blocks: list = []
    for comparison in compared:
        shown = comparison.where[:REGIMES]
        name = comparison.model.name
        caption = f"{name.capitalize()}: share of the error over share of the time."
        picture = compare_where.regimes_figure(shown)
        blocks.append(Picture(f"where_{name.split()[0]}", picture, caption))
    grid = Grid(WHERE_HEAD, where_rows(compared[0].where, REGIMES), "Base model.", words=(0, 6))
    return Section("Where the error is", [*blocks, grid], words)
