"""One simulated robot that follows the equations, with all effects of its model."""

from __future__ import annotations

import math

import numpy as np

from youbot_env.arguments import check_kind, check_number
from youbot_env.backend import FLOAT
from youbot_env.compiled import Stepper
from youbot_env.model import Model
from youbot_env.plant import ModelStructure

# A Runge-Kutta step may be this fraction of the fastest time constant.  At 0.5 the fourth-order
# error of one step stays below 1e-6 of the change within it.
STEP_FRACTION = 0.5
# Sample times, s, between which a simulation makes sense; effects keep the commands of 0.2 s.
SHORTEST, LONGEST = 1e-5, 10.0
# Steps in a sample beyond which nobody waits for the end of a simulation: the stiffest law of the
# library takes some tens at 20 Hz.
MOST_SUBSTEPS = 2000


def fastest_rate(model: Model) -> float:
    """Fastest rate of the model near rest, 1/s: steep friction laws and lags included."""
    structure = ModelStructure.of(model)
    robot = structure.bind(model.values())
    state = structure.rest()
    command = (0.0,) * len(model.platform.wheels)
    step = 1e-6

    def change(v: tuple) -> np.ndarray:
        s = robot.signals(0.0, v, (0.0, 0.0, 0.0), state.wheel_angle, command, FLOAT)
        torque, internal = robot.deliver(s, state.internal, 0.0, FLOAT)
        return np.array(robot.acceleration(robot.wrench(torque, s, internal, FLOAT), s))

    columns = []
    for axis in range(3):
        v = tuple(step if k == axis else 0.0 for k in range(3))
        columns.append((change(v) - change(tuple(-c for c in v))) / (2 * step))
    rate = float(np.abs(np.linalg.eigvals(np.array(columns))).max())
    lags = [1 / effect.time_constant(p) for _, effect, p in robot.effects]
    return max([rate, *lags])


def choose_substeps(model: Model, dt: float, fraction: float = STEP_FRACTION) -> int:
    """Runge-Kutta steps that one sample of dt needs to stay accurate for this model.

    Args:
        model: the model.
        dt: sample time, s.
        fraction: largest step in units of the fastest time constant; Runge-Kutta is stable to 2.7.

    Raises:
        ValueError: a model so stiff that no simulation of it would end.
    """
    # The small number keeps the rounding of sample times from adding a step.
    steps = dt * fastest_rate(model) / fraction - 1e-6
    if not steps < MOST_SUBSTEPS:
        raise ValueError(
            f"model {model.name!r} has a time constant of {dt / (steps * fraction):.2g} s, which "
            f"takes {steps:.2g} steps in a sample of {dt:g} s, {MOST_SUBSTEPS} are allowed; "
            "correct its friction or inertia"
        )
    return max(1, math.ceil(steps))


def history_length(structure: ModelStructure, longest_delay: float, dt: float) -> int:
    """How many torque commands ``stepping.advance`` needs for delays up to ``longest_delay``, s."""
    if not any(effect.acts("delay") for effect in structure.effects):
        return 1
    return math.floor(longest_delay / dt) + 2


class AnalyticPlant:
    """A robot that follows its model exactly, driven by torque commands held for dt.

    Args:
        model: platform, parameters and effects; in a simulation these are the true ones.
        dt: sample time, s.

    Attributes:
        platform, dt, t: wheel table, sample time and time since reset, s.

    Raises:
        ImpossibleParameters: the model describes no possible robot.
        TypeError: no model.
        ValueError: a sample time that cannot be.
    """

    def __init__(self, model: Model, dt: float = 0.01):
        check_kind("model", model, Model, "a Model, as load_model returns it")
        check_number("dt", dt, SHORTEST, LONGEST)
        self.platform, self.dt = model.platform, dt
        self._built: tuple = ()
        self.set_model(model)

    def sampled(self, dt: float) -> AnalyticPlant:
        """The same robot, at rest at the origin, with another sample time, s."""
        return AnalyticPlant(self.model, dt)

    def set_model(self, model: Model) -> None:
        """Take another model's effects and values; the robot is at rest at the origin after it."""
        model.check()
        structure = ModelStructure.of(model, track_wheels=True)
        self.model, self._robot = model, structure.bind(model.values())
        history = history_length(structure, self._robot.delay(), self.dt)
        built = (structure.key, choose_substeps(model, self.dt), history)
        if built != self._built:
            self._structure, self._built = structure, built
            self._stepper = Stepper(structure, self.dt, *built[1:])
        self._stepper.values[:] = model.values()
        self.reset()

    def reset(self, pose=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0)) -> None:
        """Place the robot at pose (x, y, yaw) m, m, rad with body velocity (V_X, V_Y, Omega)."""
        self.t = 0.0
        self._stepper.commands[:] = 0.0
        self._stepper.state[:] = self._structure.flatten(self._structure.rest(pose, velocity))

    def step(self, command) -> None:
        """Hold the shaft torques ``command`` (n,), N m, for dt."""
        commands = self._stepper.commands
        if len(commands) > 1:
            commands[1:] = commands[:-1].copy()
        commands[0] = command
        self._stepper.step(self.t)
        self.t += self.dt

    def motion(self) -> np.ndarray:
        """(x, y, yaw, V_X, V_Y, Omega), a view that the next step overwrites."""
        return self._stepper.state[:6]

    @property
    def pose(self) -> np.ndarray:
        """(x, y, yaw) in the world, m, m, rad; yaw is not wrapped."""
        return self._stepper.state[:3].copy()

    @property
    def velocity(self) -> np.ndarray:
        """(V_X, V_Y, Omega) in the body frame, m/s, m/s, rad/s."""
        return self._stepper.state[3:6].copy()

    @property
    def wheel_angle(self) -> np.ndarray:
        """Wheel angles (n,), rad."""
        return self._stepper.state[6 : 6 + len(self.platform.wheels)].copy()

    @property
    def wheel_velocity(self) -> np.ndarray:
        """Wheel speeds (n,), rad/s, as encoders see them."""
        state = self._structure.unflatten(self._stepper.state.tolist())
        command = tuple(self._stepper.commands[0].tolist())
        s = self._robot.signals(
            self.t, state.velocity, state.pose, state.wheel_angle, command, FLOAT
        )
        return np.array(self._robot.wheel_velocity(s, FLOAT, state.internal))
