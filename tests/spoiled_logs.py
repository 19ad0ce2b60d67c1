"""A good simulated log, and the ways of spoiling it that the doctor must notice."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import polars as pl

from youbot_env.compiled import Stepper
from youbot_env.model import Model
from youbot_env.parameters import Parameters
from youbot_env.plant import ModelStructure
from youbot_env.platform import youbot

CORNERS = ("fl", "fr", "rl", "rr")
V = [f"wheel_velocity_{corner}" for corner in CORNERS]
M = [f"wheel_torque_{corner}" for corner in CORNERS]
C = [f"wheel_current_{corner}" for corner in CORNERS]
R = ["reference_vx", "reference_vy", "reference_yaw_rate"]
P = ["x", "y", "yaw"]
RPM, DEG = 30 / np.pi, 180 / np.pi


def everywhere(t: float) -> np.ndarray:
    """Commanded body velocity that moves all axes."""
    return np.array(
        [
            0.25 * np.sin(0.7 * t) + 0.08 * np.sin(2.9 * t),
            0.20 * np.sin(0.9 * t + 1.0) + 0.06 * np.sin(2.3 * t),
            0.50 * np.sin(0.5 * t + 2.0) + 0.20 * np.sin(1.9 * t),
        ]
    )


def simulate(command: Callable, seconds: float = 40.0, dt: float = 0.01) -> pl.DataFrame:
    """Log of a robot with the parameters of the paper under PI wheel loops."""
    paper = Parameters(m0=35.3, I0=4.4, I1=6e-3, a_x=0.016, a_y=-0.026, mu1=0.11, mu2=5.78e-3)
    model, count = Model(youbot(), paper), round(seconds / dt)
    stepper = Stepper(ModelStructure.of(model), dt)
    stepper.values[:] = model.values()
    rng = np.random.default_rng(np.random.SeedSequence(7))
    t, J = np.arange(count) * dt, model.platform.jacobian_array
    reference = np.array([command(now) for now in t])
    speeds, torques, poses = np.empty((count, 4)), np.empty((count, 4)), np.empty((count, 3))
    integral = np.zeros(4)
    for k in range(count):
        poses[k], v = stepper.state[:3], stepper.state[3:6]
        speeds[k] = J @ v + 0.02 * rng.standard_normal(4)
        error = J @ reference[k] - speeds[k]
        integral += error * dt
        stepper.commands[0] = 0.4 * error + 2.0 * integral
        torques[k] = stepper.commands[0] + 0.03 * rng.standard_normal(4)
        stepper.step(t[k])
    poses += [1e-3, 1e-3, 2e-3] * rng.standard_normal(poses.shape)
    data = np.column_stack([t, speeds, torques, reference, poses])
    return pl.DataFrame(data, schema=["time", *V, *M, *R, *P])


@cache
def good_frame() -> pl.DataFrame:
    """Forty seconds of motion on all axes at 100 Hz."""
    return simulate(everywhere)


def text_of(frame: pl.DataFrame) -> str:
    return frame.write_csv(float_precision=6)


# Small tools that spoil a table


def scale(factor: float, *names: str) -> Callable:
    return lambda f: f.with_columns([pl.col(name) * factor for name in names])


def negate(*names: str) -> Callable:
    return scale(-1.0, *names)


def exchange(*pairs: tuple[str, str]) -> Callable:
    renamed = {a: b for pair in pairs for a, b in (pair, pair[::-1])}
    return lambda f: f.rename(renamed).select(f.columns)


def put(name: str, rows, value) -> Callable:
    """Set some cells: a number, or a function of the old values."""

    def spoil(f: pl.DataFrame) -> pl.DataFrame:
        values = f[name].to_numpy().copy()
        values[rows] = value(values[rows]) if callable(value) else value
        return f.with_columns(pl.Series(name, values))

    return spoil


def apply(names: list[str], change: Callable) -> Callable:
    return lambda f: f.with_columns([pl.Series(n, change(f[n].to_numpy().copy())) for n in names])


def both(*spoilers: Callable) -> Callable:
    def spoil(f: pl.DataFrame) -> pl.DataFrame:
        for spoiler in spoilers:
            f = spoiler(f)
        return f

    return spoil


def rows(select: Callable) -> Callable:
    return lambda f: f[select(np.arange(len(f))).tolist()]


def rename(**names: str) -> Callable:
    return lambda f: f.rename(names)


def lines(change: Callable) -> Callable:
    """Spoil the text, given and returned as a list of lines."""
    return lambda f: "\n".join(change(text_of(f).splitlines())) + "\n"


def cell(line: int, column: int, text: str) -> Callable:
    def change(all_lines: list[str]) -> list[str]:
        cells = all_lines[line - 1].split(",")
        cells[column] = text
        all_lines[line - 1] = ",".join(cells)
        return all_lines

    return lines(change)


def text(change: Callable) -> Callable:
    return lambda f: change(text_of(f))


def missing(name: str, at) -> Callable:
    def spoil(f: pl.DataFrame) -> pl.DataFrame:
        values = f[name].to_list()
        for row in at:
            values[row] = None
        return f.with_columns(pl.Series(name, values, pl.Float64))

    return spoil


def shifted(values: np.ndarray, count: int) -> np.ndarray:
    return np.concatenate([np.full(count, values[0]), values[:-count]])


def clip(share: float) -> Callable:
    return lambda v: np.clip(v, -share * np.abs(v).max(), share * np.abs(v).max())


SPIKES = np.arange(50, 4000, 250)
REST = lambda f: f.with_columns([pl.col(n) * 1e-4 for n in (*V, *M, *R, *P)])  # noqa: E731

# Mutation: (how it is made, outcome, words that must name it).  "fixed": the good log comes back;
# "refused": LogError; "told": the log is returned as it is, with a warning.
MUTATIONS: dict[str, tuple[Callable, str, str]] = {
    # signs
    "speed of fl negated": (negate(V[0]), "fixed", "velocity: fl has the other sign"),
    "speed of rr negated": (negate(V[3]), "fixed", "velocity: rr has the other sign"),
    "speeds of the left negated": (negate(V[0], V[2]), "fixed", "fl, rl have the other sign"),
    "all speeds negated": (negate(*V), "fixed", "velocity: all wheels have the other sign"),
    "torque of fr negated": (negate(M[1]), "fixed", "torque: fr has the other sign"),
    "torques of the left negated": (negate(M[0], M[2]), "fixed", "torque: fl, rl have the other"),
    "all torques negated": (negate(*M), "fixed", "torque: all wheels have the other sign"),
    "driver signs": (negate(V[0], V[2], M[0], M[2]), "fixed", "velocity and wheel_torque: fl, rl"),
    "everything of rl negated": (negate(V[2], M[2]), "fixed", "and wheel_torque: rl has the other"),
    "robot reversed": (negate(*V, *M), "fixed", "all wheels have the other sign"),
    "reference y negated": (negate(R[1]), "fixed", "reference: V_Y with the other sign"),
    "yaw negated": (negate("yaw"), "told", "pose explains 31% of what the wheels do"),
    "pose mirrored": (negate("y", "yaw"), "told", "pose: y, yaw with the other sign"),
    # order
    "speeds fl fr exchanged": (exchange((V[0], V[1])), "fixed", "velocity: fl and fr are exch"),
    "speeds fl rr exchanged": (exchange((V[0], V[3])), "fixed", "velocity: fl and rr are exch"),
    "torques fl rl exchanged": (exchange((M[0], M[2])), "fixed", "torque: fl and rl are exch"),
    "torques rl rr exchanged": (exchange((M[2], M[3])), "fixed", "torque: rl and rr are exch"),
    "rear wheels exchanged": (exchange((V[2], V[3]), (M[2], M[3])), "fixed", "torque: rl and"),
    "front and rear exchanged": (
        exchange((V[0], V[2]), (V[1], V[3]), (M[0], M[2]), (M[1], M[3])), "fixed", "fl holds rl"
    ),
    "speeds moved on by one": (
        lambda f: f.rename(dict(zip(V, V[1:] + V[:1], strict=True))), "fixed", "fl holds rr"
    ),
    "exchanged and negated": (
        both(exchange((V[0], V[1])), negate(V[0])), "fixed", "fl holds -fr, fr holds fl"
    ),
    "speed and torque exchanged": (exchange((V[0], M[0])), "refused", "wheel_velocity_fl"),
    # units
    "speeds in rpm": (scale(RPM, *V), "fixed", "rpm"),
    "speeds in deg/s": (scale(DEG, *V), "fixed", "deg/s"),
    "speeds in ticks/s": (scale(4000 / (2 * np.pi) * 9405 / 364, *V), "fixed", "ticks/s"),
    "speeds of the motor": (scale(9405 / 364, *V), "fixed", "rad/s of the motor"),
    "speeds in m/s": (scale(0.0475, *V), "fixed", "m/s at the rim"),
    "speeds in an unknown unit": (scale(3.0, *V), "refused", "2.96 times as large"),
    "one wheel in rpm": (scale(RPM, V[2]), "fixed", "rpm"),
    "one wheel of other gear": (scale(1.8, V[2]), "refused", "turns 1.8 times as fast"),
    "torques in N cm": (scale(100.0, *M), "refused", "kg in N cm"),
    "torques in mN m": (scale(1000.0, *M), "refused", "kg in mN m"),
    "torques in kN m": (scale(1e-3, *M), "refused", r"would move 0\.0\d+ kg"),
    "reference in mm/s": (scale(1000.0, *R[:2]), "told", "reference is in mm"),
    "pose in mm": (scale(1000.0, "x", "y"), "told", "pose is in mm"),
    "yaw in degrees": (scale(DEG, "yaw"), "told", "yaw is in degrees"),
    "time in ms": (scale(1e3, "time"), "fixed", ": ms; turned into s"),
    "time in us": (scale(1e6, "time"), "fixed", ": us; turned into s"),
    "time in ns": (scale(1e9, "time"), "fixed", ": ns; turned into s"),
    "time in minutes": (scale(1 / 60, "time"), "refused", "median time step is 0.000167"),
    "one sample a second": (
        rows(lambda k: k[::100]), "refused", r"step is 1; .*time \[ms\]"
    ),
    "time in hours": (scale(1 / 3600, "time"), "refused", "median time step"),
    # time
    "time stands still": (put("time", slice(None), 1.0), "refused", "time stands still"),
    "one time wrong": (put("time", [1000], 3.0), "fixed", "line 1002, column time: time runs back"),
    "one time far ahead": (put("time", [1000], 1e6), "fixed", "time runs back from 1000000"),
    "two rows exchanged": (
        lambda f: f[[*range(500), 501, 500, *range(502, 4000)]], "fixed", "sorted by time"
    ),
    "time starts again": (
        put("time", slice(2000, None), lambda t: t - 20), "refused", "line 2002.*back from 19.99"
    ),
    "log written twice": (lambda f: pl.concat([f, f]), "refused", "runs back from 39.99 to 0"),
    "rows repeated": (
        lambda f: f[[*range(100), 99, 99, *range(100, 4000)]], "fixed", "stands there again"
    ),
    "time with one digit": (apply(["time"], lambda t: np.floor(t * 10) / 10), "refused", "again"),
    "a gap": (rows(lambda k: k[(k < 1000) | (k > 1100)]), "fixed", "the longest 1.02 s"),
    "jitter": (
        apply(["time"], lambda t: t + 0.004 * np.sin(1e5 * t**2)), "told", "time steps vary by"
    ),
    "time missing in a row": (missing("time", [70]), "fixed", "1 rows have no time"),
    "no time": (lambda f: f.drop("time"), "refused", "no column 'time'"),
    # cells
    "a word in a cell": (cell(57, 3, "abc"), "refused", "line 57, column wheel_velocity_rl: 'abc'"),
    "empty cells": (missing(V[1], [10, 500, 501]), "fixed", "3 missing values"),
    "nan cells": (cell(57, 3, "NaN"), "fixed", "line 57, column wheel_velocity_rl: 1 missing"),
    "an infinite cell": (cell(57, 6, "inf"), "fixed", "line 57, column wheel_torque_fr: 1 missing"),
    "a second missing": (missing(V[1], range(700, 800)), "fixed", "100 samples in 1 stretches"),
    "islands between missing stretches": (
        missing(V[1], [*range(700, 710), *range(714, 724)]), "fixed", "less than 10 samples"
    ),
    "half a column missing": (missing(M[0], range(0, 4000, 2)), "refused", "50% of the column"),
    "a column empty": (missing(M[0], range(4000)), "refused", "4000 missing"),
    "pose missing for a while": (missing("x", range(300, 600)), "told", "pose is left out"),
    # sensors
    "spikes in a speed": (put(V[0], SPIKES, 50.0), "fixed", "16 spikes, the largest 50"),
    "small spikes": (put(V[0], SPIKES, lambda v: v + 6.0), "fixed", "spikes"),
    "long glitch": (put(V[3], slice(900, 906), 1e4), "fixed", "6 spikes, the largest 10000"),
    "a torque spike": (put(M[1], [777], -80.0), "fixed", "line 779, column wheel_torque_fr: 1 spi"),
    "many spikes": (
        put(V[0], slice(0, None, 20), lambda v: 90.0 + 3 * v), "refused", "5% of the samples"
    ),
    "speed stuck": (put(V[2], slice(1500, 1800), 2.0), "fixed", "stands at 2 for 2.99 s"),
    "speed dead": (put(V[2], slice(None), 0.0), "refused", "always 0 while the others change"),
    "speed stuck for long": (put(V[2], slice(1000, 3000), 2.0), "refused", "50% of the log"),
    "torque stuck": (put(M[2], slice(1500, 1900), 0.123), "fixed", "stands at 0.123"),
    "torque dead": (put(M[3], slice(None), 0.5), "refused", "wheel_torque_rr: always 0.5"),
    "speed saturated at times": (apply([V[0]], clip(0.9)), "fixed", "stands at its limit"),
    "speed saturated": (apply([V[0]], clip(0.6)), "refused", "wheel_velocity_fl: .*saturated in"),
    "torques saturated": (apply(M, clip(0.6)), "told", "wheel_torque_fl: .*saturated"),
    "slow sensor": (apply(V, lambda v: np.repeat(v[::10], 10)), "told", "slower than the log"),
    "speed with an offset": (apply([V[1]], lambda v: v + 3.0), "told", "has an offset"),
    "one speed late": (apply([V[1]], lambda v: shifted(v, 40)), "told", "late by about 0.4 s"),
    "torques late": (apply(M, lambda v: shifted(v, 60)), "told", "wheel_torque.*late by about 0.6"),
    "noise on one speed": (
        apply([V[1]], lambda v: v + 6 * np.sin(1e5 * np.arange(len(v)) ** 1.5)), "told",
        "contradict rolling",
    ),
    "robot at rest": (REST, "refused", "hardly moves"),
    "two samples": (rows(lambda k: k[:2]), "refused", "lasts 0.01 s"),
    "one second": (rows(lambda k: k[:100]), "refused", "lasts 0.99 s"),
    # text
    "cut off in a row": (text(lambda s: s[:-40]), "fixed", "the file is cut off there"),
    "a row cut short": (lines(lambda a: [*a[:90], a[90][:30], *a[91:]]), "fixed", "line 91"),
    "a row too long": (lines(lambda a: [*a[:90], a[90] + ",1", *a[91:]]), "fixed", "line 91: 16 c"),
    "half of the rows short": (
        lines(lambda a: [r if k % 2 == 0 else r[:30] for k, r in enumerate(a)]), "refused",
        "lines are broken",
    ),
    "empty file": (lambda f: "", "refused", "file is empty"),
    "only the names": (lines(lambda a: a[:1]), "refused", "no row after the names"),
    "only comments": (lambda f: "# nothing\n# here\n", "refused", "only comments"),
    "binary file": (lambda f: b"time,x\n" + bytes(range(256)), "refused", "NUL"),
    "no names": (lines(lambda a: a[1:]), "refused", "line 1: it begins with '0.000000' where"),
    "too many names": (lambda f: ",".join(f"c{k}" for k in range(5000)), "refused", "5000 columns"),
    "a name twice": (
        lines(lambda a: [a[0].replace(V[1], V[0]), *a[1:]]), "refused", "stand there twice"
    ),
    "a corner twice": (
        lambda f: f.with_columns(pl.col(V[2]).alias("wheel_velocity_bl")), "refused",
        "are both wheel_velocity_rl",
    ),
    "decimal commas": (text(lambda s: s.replace(",", ";").replace(".", ",")), "fixed", "decimal"),
    "decimal commas between commas": (text(lambda s: s.replace(".", ",")), "refused", "decimal"),
    "spaces between columns": (text(lambda s: s.replace(",", " ")), "refused", "only one column"),
    "bars between columns": (text(lambda s: s.replace(",", "|")), "refused", "only one column"),
    "names by comma, rows by semicolon": (
        lines(lambda a: [a[0], *(r.replace(",", ";") for r in a[1:])]), "refused", "one separator"
    ),
    # names
    "a wheel missing": (lambda f: f.drop(V[3]), "refused", r"without \['wheel_velocity_rr'\]"),
    "no torques": (lambda f: f.drop(M), "told", "no drive input of the wheels fl, fr, rl, rr"),
    "no torques and no pose": (lambda f: f.drop(M + P), "refused", "no drive input of the wheels"),
    "no speeds": (lambda f: f.drop(V), "refused", "no velocities of wheels or body"),
    "a name misspelt": (rename(wheel_torque_rl="wheel_torqe_rl"), "refused", "wheel_torque_rl"),
    "unknown columns": (
        lambda f: f.with_columns(temperature=pl.lit(20.0), note=pl.lit("x")), "fixed",
        "2 unknown columns: temperature, note; ignored",
    ),
}  # fmt: skip
