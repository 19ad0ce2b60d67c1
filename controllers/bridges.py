"""A model in the types that control engineers use: CasADi function and python-control systems."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from controllers.columns import Columns
from controllers.estimator import OPS
from controllers.inverse import SETTLED, feedforward
from youbot_env.backend import FLOAT
from youbot_env.model import Model
from youbot_env.plant import ModelStructure
from youbot_env.stepping import pose_rate

if TYPE_CHECKING:
    import control

# No wheel torque of interest is larger, N m.
LARGEST_TORQUE = 50.0


def rate_function(model: Model) -> ca.Function:
    """Trace the equations of motion as ``F(t, x, u, values) -> x'``.

    Args:
        model: its effects are traced; its values are the last argument, as ``Model.values()``.

    Returns:
        A function of time, s, the state named by ``state_names``, wheel torque commands (n,), N m,
        and values.

    Raises:
        ValueError: the model has a pure delay, which no finite state describes.
    """
    structure = ModelStructure.of(model)
    delayed = [e.identifier for e in structure.effects if e.acts("delay")]
    if delayed:
        raise ValueError(
            f"model {model.name!r} has {delayed}: a delay is no state; leave it out of the model "
            "and put a delay (control.pade, a buffer) in front of the system"
        )
    t, h, x = ca.SX.sym("t"), ca.SX.sym("h"), ca.SX.sym("x", len(state_names(model)))
    u = ca.SX.sym("u", len(model.platform.wheels))
    values = ca.SX.sym("values", structure.value_count)
    robot, state = structure.bind(ca.vertsplit(values)), structure.unflatten(ca.vertsplit(x))
    given = tuple(ca.vertsplit(u))
    s = robot.signals(t, state.velocity, state.pose, state.wheel_angle, given, OPS)
    torque, _ = robot.deliver(s, state.internal, 0.0, OPS)
    change = robot.acceleration(robot.wrench(torque, s, state.internal, OPS), s)
    speeds = robot.wheel_velocity(s, OPS) if state.wheel_angle else ()
    # Effects give their state after h seconds; its slope at h = 0 is the rate.
    _, internal = robot.deliver(s, state.internal, h, OPS)
    later = ca.vertcat(*sum(internal, ()))
    inner = ca.substitute(ca.jacobian(later, h), h, 0.0) if internal and later.numel() else ca.SX()
    pose = pose_rate(state.velocity, state.pose[2], OPS)
    rates = ca.cse(ca.vertcat(*pose, *change, *speeds, ca.densify(inner)))
    return ca.Function("rates", [t, x, u, values], [rates], ["t", "x", "u", "values"], ["rate"])


def state_names(model: Model) -> list[str]:
    """Names of the states: pose, body velocity, then what the effects of the model need."""
    structure = ModelStructure.of(model)
    names = ["x", "y", "yaw", "V_X", "V_Y", "Omega"]
    if structure.track_wheels:
        names += [f"wheel_angle_{wheel}" for wheel in model.platform.wheel_names]
    for effect in structure.effects:
        names += [f"{effect.identifier}_{k}" for k in range(effect.state_size(model.platform))]
    return names


def nonlinear_system(model: Model) -> control.NonlinearIOSystem:
    """Return the model as a python-control system.

    Inputs are the torque commands of the wheels (``wheel_torque_<name>``, N m), outputs the states.
    The values of the model are its ``params`` by name, so a simulation may change them.
    """
    import control

    rates, names = Columns(rate_function(model)), model.names()

    def update(t, x, u, params):
        values = np.array([params[name] for name in names])
        return rates.one(t, x, u, values)[0].copy()

    return control.NonlinearIOSystem(
        update,
        None,
        inputs=[f"wheel_torque_{wheel}" for wheel in model.platform.wheel_names],
        outputs=state_names(model),
        states=state_names(model),
        params=dict(zip(names, model.values(), strict=True)),
        name=model.name,
    )


def linear_system(
    model: Model, velocity: tuple = (0.0, 0.0, 0.0), yaw: float = 0.0
) -> control.StateSpace:
    """Linearise the model about steady motion.

    Args:
        model: its effects are linearised as they are; dry friction is steep at rest.
        velocity: body velocity (V_X, V_Y, Omega); the torques are those that hold it.
        yaw: heading, rad.

    Returns:
        A system of deviations, with the inputs, states and outputs of ``nonlinear_system``.
    """
    import control

    structure = ModelStructure.of(model)
    robot, rest = structure.bind(model.values()), structure.rest((0.0, 0.0, yaw), tuple(velocity))
    held = feedforward(robot, rest, rest.velocity, (0.0,) * 3, 0.0, LARGEST_TORQUE, FLOAT)
    s = robot.signals(0.0, rest.velocity, rest.pose, rest.wheel_angle, held, FLOAT)
    _, internal = robot.deliver(s, rest.internal, SETTLED, FLOAT)
    point = np.array(structure.flatten(rest._replace(internal=internal)))
    rates = rate_function(model)
    t, x, u, values = rates.sx_in()
    slope = rates(t, x, u, values)
    slopes = ca.Function(
        "slopes", [t, x, u, values], [ca.jacobian(slope, x), ca.jacobian(slope, u)]
    )
    a, b = (np.asarray(part) for part in slopes(0.0, point, held, model.values()))
    return control.ss(
        a,
        b,
        np.eye(len(a)),
        np.zeros_like(b),
        inputs=[f"wheel_torque_{wheel}" for wheel in model.platform.wheel_names],
        outputs=state_names(model),
        states=state_names(model),
        name=f"{model.name} linearised",
    )
