"""How a simulated log answers to small changes of the model: the linear core of output error.

A log is simulated in windows from its drive input alone.  Around that simulation the velocity error
obeys the linear equation

    d/dt dv = A(t) dv + da(t),    A = da/dv,

where da is the change of the acceleration at equal velocity.  Since da of any model (other values,
an effect more) is the one physics evaluated along the simulation, hundreds of changes cost little
more than one simulation.  Columns carry no measurement noise: they come from the simulation, not
from the measured velocities, so feedback in the drive does not bias what is fitted with them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.dead_reckoning import wheel_angles
from ident.free_run import LEAST_WINDOW, Windows, cut_windows, fitting, seen_by_sensors
from ident.log import Log
from ident.memo import Memo, part_of
from ident.restored import INSTRUMENTS, restored
from ident.signals import delivered_torques, internal_states, observed_motion
from youbot_env import dynamics
from youbot_env.backend import NUMPY
from youbot_env.effects.base import Signals
from youbot_env.model import Model
from youbot_env.plant import BoundModel, ModelStructure

# Windows: at most this long, s, and as many in a log as statistics over windows need.
LONGEST, WANTED = 4.0, 28
# Step of numerical derivatives: relative, and the size from which it is relative.
STEP, SMALL = 1e-3, 1e-2
# The same for velocities, m/s and rad/s: far below the speeds over which dry friction turns round.
NUDGE = 1e-6

DRIVE = ("drive", "delay")
# Largest step of a simulation, in units of the fastest time constant: what is lost is far below the
# noise of a log.
COARSE = 2.0


def window_length(log: Log) -> float:
    """Length of the windows of a log, s."""
    if log.window is not None:
        return max(log.window, log.dt)
    return fitting(log, float(np.clip(log.duration / WANTED, LEAST_WINDOW, LONGEST)))


@dataclass(frozen=True, eq=False)
class Linearised:
    """A log simulated with a model, and the linear equation of small deviations.

    Attributes:
        raw, model: what is simulated with what.
        log: the record with the model's instruments undone.
        windows: the cut log.
        states: (W, L + 1, size) simulated states, the start of each window first.
    """

    raw: Log
    log: Log
    model: Model
    windows: Windows
    states: np.ndarray

    @classmethod
    def of(cls, log: Log, model: Model, window: float | None = None) -> Linearised:
        """Simulate a log.

        Raises:
            ValueError: no contiguous piece of the log holds a window.
        """
        windows = cut_windows(log, model, window or window_length(log), COARSE)
        after = windows.simulate(model.values())
        seen = restored(log, model)
        return cls(
            log, seen, model, windows, np.concatenate([windows.start.T[:, None], after], axis=1)
        )

    @property
    def shape(self) -> tuple[int, int]:
        """(W, L) windows and samples of each."""
        return self.windows.index.shape

    @cached_property
    def residual(self) -> np.ndarray:
        """(W, L, m) measured less simulated outputs.

        Outputs are the wheel speeds, rad/s, or, where they were measured by themselves, the body
        velocities, m/s, m/s, rad/s.
        """
        return _output(self.raw)[self.windows.index] - self._shaped(self._present[1])

    @cached_property
    def begin(self) -> np.ndarray:
        """(W,) time at which each window begins, s."""
        return self.log.time[self.windows.index[:, 0]]

    @property
    def measured(self) -> np.ndarray:
        """(N, m) what the outputs are compared with, the instruments undone."""
        return _output(self.log)

    def value_columns(self, chosen: np.ndarray | None = None) -> np.ndarray:
        """(W, L, m, k) derivatives of the outputs by the values of the model, or chosen ones."""
        values = np.array(self.model.values(), float)
        chosen = np.ones(len(values), bool) if chosen is None else chosen
        steps = STEP * np.maximum(np.abs(values), SMALL)
        moved = (values + np.diag(steps))[chosen]
        changes = [self._change(self.model, row, self._present) for row in moved]
        return self._follow(changes) / steps[chosen]

    def model_columns(self, pairs: Iterable[tuple[Model, Model]]) -> np.ndarray:
        """(W, L, m, K) changes of the outputs from the first to the second model of each pair."""
        changes, last, before = [], self.model, self._present
        for first, second in pairs:
            if first is not last:
                last = first
                before = self._present if first is self.model else self._evaluate(first)
            changes.append(self._change(second, None, before))
        return self._follow(changes)

    def force_columns(self, wrenches: Iterable[np.ndarray]) -> np.ndarray:
        """(W, L, m, K) changes of the outputs under extra wrenches (3, W L) on the body, N, N m."""
        robot, s = self._robot, self.signals
        mass = robot.inertia_at(s).mass
        return self._follow_drive([self._stack(dynamics.solve(mass, tuple(w))) for w in wrenches])

    @cached_property
    def signals(self) -> Signals:
        """What the laws read, half way through each sample interval, components (W L,)."""
        return self._signals(self._robot, 0.5)

    @cached_property
    def time(self) -> np.ndarray:
        """(W, L) time of the outputs from the start of the log, s."""
        return self.log.time[self.windows.index] - self.log.time[0]

    @cached_property
    def wheel_angle(self) -> np.ndarray:
        """(n, W L) measured wheel angles half way through each sample interval, rad."""
        rows, angles = self._rows, self._angles
        return 0.5 * (angles[rows] + angles[rows + 1]).T

    @cached_property
    def _rows(self) -> np.ndarray:
        """(W L,) row of the log at which each sample interval begins."""
        return (self.windows.index - 1).ravel()

    @cached_property
    def _middle(self) -> np.ndarray:
        return (0.5 * (self.states[:, :-1] + self.states[:, 1:])).reshape(-1, self.states.shape[2])

    @cached_property
    def _end(self) -> np.ndarray:
        return self.states[:, 1:].reshape(-1, self.states.shape[2])

    @cached_property
    def _angles(self) -> np.ndarray:
        return wheel_angles(self.log)

    @cached_property
    def _robot(self) -> BoundModel:
        return ModelStructure.of(self.model).bind(self.model.values())

    @cached_property
    def _present(self) -> tuple[np.ndarray, np.ndarray]:
        return self._evaluate(self.model)

    def _change(self, model: Model, values, before) -> tuple[np.ndarray, np.ndarray]:
        after = self._evaluate(model, values)
        return after[0] - before[0], after[1] - before[1]

    def _evaluate(
        self, model: Model, values=None, ahead: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Acceleration (3, W L) half way and outputs (m, W L) at the end of each interval.

        ``ahead`` (3,) is added to all velocities.
        """
        values = model.values() if values is None else values.tolist()
        structure = ModelStructure.of(model)
        robot, rest = structure.bind(values), structure.rest().internal
        rolling = part_of(model, values, ("kinematics",))
        reads = robot.reads_pose, robot.reads_wheel_angle
        instruments = part_of(model, values, INSTRUMENTS)
        log = restored(self.raw, model, values)

        def motions() -> list[tuple]:
            return [observed_motion(p, robot, log.time[0]) for p in log.pieces()]

        def delivered() -> tuple:
            seen = self._memo.of(("motions", rolling, reads, instruments), motions)
            return tuple(delivered_torques(log, model, values, seen)[self._rows].T)

        driven = part_of(model, values, DRIVE)
        torque = self._memo.of(("torque", driven, instruments), delivered)
        s = self._signals(robot, 0.5, ("middle", rolling), ahead)
        wrench = robot.wrench(torque, s, self._inner(structure, log, model, values), NUMPY)
        placed = (rolling, part_of(model, values, ("inertial",)), tuple(values[:7]))
        inertia = self._memo.of(("inertia", placed), lambda: robot.inertia_at(s))
        acceleration = self._stack(robot.acceleration(wrench, s, inertia))

        def outputs() -> np.ndarray:
            s = self._signals(robot, 1.0, ("end", rolling), ahead)
            if robot.acting("slip"):
                robot.wrench(torque, s, rest, NUMPY)
            shown = self._stack(seen_by_sensors(robot, s, self.log))
            # What an instrument did to the velocities it does to those that are simulated.
            if _output(log) is _output(self.raw):
                return shown
            return shown + (_output(self.raw) - _output(log))[self.windows.index.ravel()].T

        if ahead is None and not robot.acting("slip"):
            return acceleration, self._memo.of(("outputs", rolling, instruments), outputs)
        return acceleration, outputs()

    def _inner(self, structure: ModelStructure, log: Log, model: Model, values) -> tuple:
        """States of the effects half way through each interval, along the measured motion.

        Those of the drive have done their work already; at rest where no other law has any.
        """
        if not structure.bristled:
            return structure.rest().internal

        def middle() -> np.ndarray:
            states, rows = internal_states(log, model, values), self._rows
            return 0.5 * (states[rows] + states[rows + 1]).T

        moving = part_of(model, values, (*DRIVE, "evolve", "kinematics", *INSTRUMENTS))
        return structure.parted(self._memo.of(("states", moving), middle))

    @cached_property
    def _memo(self) -> Memo:
        return Memo()

    def _signals(
        self,
        robot: BoundModel,
        share: float,
        key: tuple | None = None,
        ahead: np.ndarray | None = None,
    ) -> Signals:
        """What the laws read at a share of each sample interval, ``ahead`` (3,) added to v."""
        t, v, pose = self._motion(share)
        angle = self._turned(share) if robot.reads_wheel_angle else ()
        if ahead is not None:
            v = tuple(component + more for component, more in zip(v, ahead, strict=True))
        if not (key and robot.acting("kinematics")):
            return robot.signals(t, v, pose, angle, self._commands, NUMPY)
        geometry = self._memo.of(
            key, lambda: robot.signals(t, v, pose, angle, self._commands, NUMPY).geometry
        )
        return robot.signals(t, v, pose, angle, self._commands, NUMPY, geometry)

    def _motion(self, share: float) -> tuple:
        """Time (W L,), velocities and pose by components (W L,), half way or at the end."""
        if share not in self._motions:
            rows, time = self._rows, self.log.time
            states = np.ascontiguousarray((self._middle if share == 0.5 else self._end)[:, :6].T)
            t = (1 - share) * time[rows] + share * time[rows + 1] - time[0]
            self._motions[share] = t, tuple(states[3:]), tuple(states[:3])
        return self._motions[share]

    def _turned(self, share: float) -> tuple:
        """Measured wheel angles by wheel (W L,), rad, at a share of each sample interval."""
        if share not in self._angles_at:
            rows, angles = self._rows, self._angles
            angle = (1 - share) * angles[rows] + share * angles[rows + 1]
            self._angles_at[share] = tuple(np.ascontiguousarray(angle.T))
        return self._angles_at[share]

    @cached_property
    def _motions(self) -> dict[float, tuple]:
        return {}

    @cached_property
    def _angles_at(self) -> dict[float, tuple]:
        return {}

    @cached_property
    def _commands(self) -> tuple:
        return tuple(np.ascontiguousarray(self.log.command[self._rows].T))

    @cached_property
    def _slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives by velocity: of accelerations (W L, 3, 3) and of outputs (W L, m, 3)."""
        slopes = []
        for ahead in NUDGE * np.eye(3):
            moved = self._evaluate(self.model, None, ahead)
            slopes.append([(a - b) / NUDGE for a, b in zip(moved, self._present, strict=True)])
        return tuple(np.stack(part).transpose(2, 1, 0) for part in zip(*slopes, strict=True))

    @cached_property
    def _transition(self) -> tuple[np.ndarray, np.ndarray]:
        """(W, L, 3, 3) from dv to the next dv, and from a held da to it, by the trapezoidal rule.

        The rule is stable however steep a friction law is.
        """
        h, A = self.windows.step.reshape(-1, 1, 1), self._slopes[0]
        inverse = np.linalg.inv(np.eye(3) - 0.5 * h * A)
        shape = (*self.shape, 3, 3)
        return (inverse @ (np.eye(3) + 0.5 * h * A)).reshape(shape), (inverse * h).reshape(shape)

    def _follow(self, changes: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """(W, L, m, K) outputs that follow from changes of acceleration and of outputs."""
        columns = self._follow_drive([acceleration for acceleration, _ in changes])
        for k, (_, outputs) in enumerate(changes):
            if np.any(outputs):
                columns[..., k] += self._shaped(outputs)
        return columns

    def _follow_drive(self, changes: list[np.ndarray]) -> np.ndarray:
        """(W, L, m, K) outputs that follow from changes of acceleration (3, W L)."""
        (windows, length), count = self.shape, len(changes)
        if not changes:
            return np.zeros((*self.residual.shape, 0))
        drive = np.stack(changes, axis=-1).reshape(3, windows, length, count)
        keep, gain = self._transition
        drive = np.einsum("wlij,jwlk->lwik", gain, drive, optimize=True)
        dv = np.empty((length, windows, 3, count))
        now = np.zeros((windows, 3, count))
        for at in range(length):
            now = keep[:, at] @ now + drive[at]
            dv[at] = now
        slope = self._slopes[1].reshape(windows, length, -1, 3)
        return slope @ dv.transpose(1, 0, 2, 3)

    def _shaped(self, flat: np.ndarray) -> np.ndarray:
        return flat.reshape(-1, *self.shape).transpose(1, 2, 0)

    def _stack(self, components) -> np.ndarray:
        return np.array([np.broadcast_to(c, len(self._rows)) for c in components], float)


def _output(log: Log) -> np.ndarray:
    """(N, m) what a simulation is compared with: body velocities if measured, else wheel speeds."""
    return log.wheel_velocity if log.body_velocity is None else log.body_velocity
