"""Free run: velocities simulated from the measured drive input alone, against the measured ones.

Each window starts at the measured velocity and pose and sees no measurement after that, but for the
wheel angles where a law reads them (rollers, ripple): encoders know them far better than a
simulation does after some turns.  What is compared is what the sensors would show of the simulated
motion: with finite rollers or slip that is not the motion itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from ident.dead_reckoning import wheel_angles
from ident.log import Log
from ident.restored import restored
from ident.signals import body_velocity, internal_states, observed_motion
from youbot_env.backend import NUMPY
from youbot_env.compiled import advance_function
from youbot_env.effects.base import Signals
from youbot_env.model import Model
from youbot_env.plant import BoundModel, ModelStructure
from youbot_env.simulation.analytic import STEP_FRACTION, choose_substeps, history_length

WINDOW = 5.0
# What a record begins with is left out: what the drive was told before it still acts, s.
LEAD = 0.1
# Runge-Kutta steps a sample, beyond which no robot is that stiff: values that a search tries and
# leaves again.
MOST_SUBSTEPS = 40
# A rest at the end of a piece that is longer than this, s, gets a window of its own.
REST = 0.5
# Distance of windows far shorter than that, s.
SPACED = 0.5
# Shorter runs, s, hold no window.
LEAST_WINDOW = 2.0


@dataclass(frozen=True)
class FreeRun:
    """Simulated against measured body velocities.

    Attributes:
        time: (N,) s.
        simulated, measured: (N, 3) m/s, m/s, rad/s.
        window: (N,) number of the window.
    """

    time: np.ndarray
    simulated: np.ndarray
    measured: np.ndarray
    window: np.ndarray

    @property
    def rmse(self) -> np.ndarray:
        """(3,) root mean square errors of V_X, V_Y m/s and Omega rad/s."""
        return np.sqrt(np.mean((self.simulated - self.measured) ** 2, axis=0))

    @property
    def nrmse(self) -> float:
        """Error as a share of the signals' rms about their means, over the three axes."""
        spread = self.measured.std(axis=0)
        moving = spread > 1e-9
        return float(np.sqrt(np.mean((self.rmse[moving] / spread[moving]) ** 2)))


@dataclass(frozen=True)
class Windows:
    """A log cut into windows of equal length for one model structure.

    Attributes:
        start: (size, W) states at the beginning of each window.
        commands: (n * history, L * W) torque commands, newest first.
        clock, step: (1, L * W) time from the start of the log and sample times, s.
        angles: (n, L * W) measured wheel angles at the start of each sample, rad; (0, L * W)
            where no law reads them.
        index: (W, L) rows of the log that the simulation is compared with.
        structure, substeps, history: what is simulated.
    """

    start: np.ndarray
    commands: np.ndarray
    clock: np.ndarray
    step: np.ndarray
    angles: np.ndarray
    index: np.ndarray
    structure: ModelStructure
    substeps: int
    history: int

    @property
    def function(self) -> ca.Function:
        """``F(start, commands, values, clock, step, angles) -> states (size, L * W)``."""
        count, length = self.index.shape
        advance = advance_function(self.structure, self.substeps, self.history)
        return _windows_function(advance, length, count, len(self.angles))

    def simulate(self, values) -> np.ndarray:
        """States (W, L, size) after each sample for flat parameter values."""
        inputs = (np.asarray(values), self.clock, self.step, self.angles)
        states = self.function(self.start, self.commands, *inputs)
        count, length = self.index.shape
        return np.asarray(states).T.reshape(count, length, -1)


def cut_windows(
    log: Log, model: Model, window: float = WINDOW, fraction: float = STEP_FRACTION
) -> Windows:
    """Cut a log into windows of ``window`` seconds, the last of a piece ending where it ends.

    That one overlaps the one before it; pieces shorter than a window are left out.  Windows of a
    log that is judged in short ones stand apart: what lies between two of them is alike.

    Args:
        log: as recorded; the model's instruments are undone here.
        model: what is to be simulated.
        window: length, s.
        fraction: that of ``choose_substeps``.

    Raises:
        ValueError: no contiguous piece holds one window.
    """
    structure, log = ModelStructure.of(model), restored(log, model)
    dt = log.dt
    try:
        substeps = min(choose_substeps(model, dt, fraction), MOST_SUBSTEPS)
    except ValueError:  # values that a search tries and leaves again
        substeps = MOST_SUBSTEPS
    delay = structure.bind(model.values()).delay()
    history = history_length(structure, delay, dt)
    length = max(1, round(window / dt))
    starts, blocks, index, clocks, steps, angles = [], [], [], [], [], []
    robot = structure.bind(model.values())
    velocity, offset, command = _velocities(log, robot), 0, log.command
    turned = wheel_angles(log) if structure.track_wheels else np.empty((len(log.time), 0))
    inner = internal_states(log, model)
    for piece in log.pieces():
        count = len(piece.time)
        past = np.stack([np.maximum(np.arange(count) - k, 0) for k in range(history)], axis=1)
        lead = max(0, min(round(LEAD / dt), count - 1 - length))
        apart = length if log.window is None else max(length, round(SPACED / dt))
        begins = list(range(lead, count - length, apart))
        if begins and log.window is None and count - 1 - length - begins[-1] > REST / dt:
            begins.append(count - 1 - length)
        for begin in begins:
            rows = offset + begin + np.arange(length)
            pose = (0.0, 0.0, 0.0) if log.pose is None else log.pose[rows[0]]
            starts.append([*pose, *velocity[rows[0]], *turned[rows[0]], *inner[rows[0]]])
            angles.append(turned[rows])
            blocks.append(command[offset + past[begin : begin + length]].reshape(length, -1))
            clocks.append(log.time[rows] - log.time[0])
            steps.append(log.time[rows + 1] - log.time[rows])
            index.append(rows + 1)
        offset += count
    if not starts:
        raise ValueError(
            f"log {log.name!r} lasts {log.duration:.3g} s and has no contiguous window of "
            f"{window:.3g} s; choose a shorter window or record longer"
        )
    return Windows(
        np.array(starts).T,
        np.concatenate(blocks).T,
        np.concatenate(clocks)[None],
        np.concatenate(steps)[None],
        np.concatenate(angles).T,
        np.array(index),
        structure,
        substeps,
        history,
    )


def _velocities(log: Log, robot: BoundModel) -> np.ndarray:
    """(N, 3) body velocities of a log, by the wheels of the model where these are all there is."""
    if log.body_velocity is not None or not robot.acting("kinematics"):
        return log.velocity()
    seen = [observed_motion(piece, robot, log.time[0])[0] for piece in log.pieces()]
    return np.concatenate([np.stack(v, axis=1) for v in seen])


def fitting(log: Log, window: float) -> float:
    """The window, s, shortened to what the shortest run of a log holds."""
    longest: dict[int, float] = {}
    for start, stop in log.spans:
        run, span = int(log.run_of(log.time[start])), log.time[stop - 1] - log.time[start]
        longest[run] = max(longest.get(run, 0.0), float(span))
    held = [span - log.dt for span in longest.values() if span > LEAST_WINDOW]
    return min([window, *held])


def free_run(log: Log | Sequence[Log], model: Model, window: float = WINDOW) -> FreeRun:
    """Simulate logs' windows with a model from the measured drive input alone.

    Windows of ``WINDOW`` or less are shortened to what the runs of a log hold.
    """
    if not isinstance(log, Log):
        return (
            free_run(log[0], model, window)
            if len(log) == 1
            else _joined([free_run(one, model, window) for one in log])
        )
    window = fitting(log, window) if window <= WINDOW else window
    windows, log = cut_windows(log, model, window), restored(log, model)
    rows = windows.index.ravel()
    states = windows.simulate(model.values()).reshape(len(rows), -1)
    simulated = _shown(log, model, windows, states)
    number = np.repeat(np.arange(len(windows.index)), windows.index.shape[1])
    return FreeRun(log.time[rows], simulated, log.velocity()[rows], number)


def _joined(runs: list[FreeRun]) -> FreeRun:
    """Free runs of several logs as one, with time running on from one to the next."""
    times, windows, end, count = [], [], runs[0].time[0], 0
    for run in runs:
        times.append(run.time - run.time[0] + end)
        windows.append(run.window + count)
        end, count = times[-1][-1] + (run.time[1] - run.time[0]), int(windows[-1][-1]) + 1
    shown = [np.concatenate([getattr(r, n) for r in runs]) for n in ("simulated", "measured")]
    return FreeRun(np.concatenate(times), *shown, np.concatenate(windows))


def seen_by_sensors(robot: BoundModel, s: Signals, log: Log) -> tuple:
    """Outputs that a log's sensors show of a motion: wheel speeds, or body velocities if measured.

    Where a model slips, the wrench must have been evaluated on the signals before.
    """
    return robot.wheel_velocity(s, NUMPY) if log.body_velocity is None else s.v


def _shown(log: Log, model: Model, windows: Windows, states: np.ndarray) -> np.ndarray:
    """(N, 3) body velocities as the log would state them, of simulated states (N, size)."""
    robot = windows.structure.bind(model.values())
    rolls = robot.acting("kinematics") or robot.acting("slip")
    if log.body_velocity is not None or not rolls:
        return states[:, 3:6]
    rows = windows.index.ravel()
    angle = tuple(wheel_angles(log)[rows].T) if robot.reads_wheel_angle else ()
    command = tuple(log.command[rows - 1].T)
    pose, v = tuple(states[:, :3].T), tuple(states[:, 3:6].T)
    s = robot.signals(log.time[rows] - log.time[0], v, pose, angle, command, NUMPY)
    speed = robot.wheel_velocity(s, NUMPY, windows.structure.rest().internal)
    n = len(rows)
    ideal = body_velocity(log.platform.geometry, tuple(np.broadcast_to(w, n) for w in speed))
    return np.stack(ideal, axis=1)


@lru_cache(maxsize=32)
def _windows_function(advance: ca.Function, length: int, count: int, angles: int) -> ca.Function:
    """One window is the step accumulated over its samples; all windows are mapped over it."""
    size, wheels = advance.size1_in(0), advance.numel_in(1)
    step_in = [ca.SX.sym(advance.name_in(k), *advance.size_in(k)) for k in range(5)]
    turned = ca.SX.sym("angles", angles)
    placed = ca.vertcat(step_in[0][:6], turned, step_in[0][6 + angles :])
    measured = ca.Function("sample", [*step_in, turned], [advance(placed, *step_in[1:])],
                           [*advance.name_in(), "angles"], ["next"])  # fmt: skip
    along = measured.mapaccum("window", length, ["state"], ["next"])
    start = ca.MX.sym("start", size, count)
    commands = ca.MX.sym("commands", wheels, length * count)
    values = ca.MX.sym("values", advance.size1_in(2))
    clock, step = ca.MX.sym("clock", 1, length * count), ca.MX.sym("step", 1, length * count)
    known = ca.MX.sym("angles", angles, length * count)
    shaped = ca.reshape(commands, advance.size1_in(1), -1)
    states = []
    for k in range(count):
        columns = slice(k * length, (k + 1) * length)
        past = shaped[:, k * length * advance.size2_in(1) : (k + 1) * length * advance.size2_in(1)]
        fixed = ca.repmat(values, 1, length)
        states.append(
            along(start[:, k], past, fixed, clock[columns], step[columns], known[:, columns])
        )
    inputs = [start, commands, values, clock, step, known]
    return ca.Function("windows", inputs, [ca.horzcat(*states)])
