"""Models as CasADi functions and python-control systems."""

import numpy as np
import pytest

from controllers.bridges import linear_system, nonlinear_system, rate_function, state_names
from youbot_env.model_file import load_model
from youbot_env.simulation import AnalyticPlant

control = pytest.importorskip("control")
PAPER = load_model("paper")
RICH = PAPER.with_effects(
    {"actuator_lag": 0.05, "wheel_coulomb_friction": 0.1, "floor_slope": None}
)


def test_nonlinear_system_moves_as_the_plant():
    system, plant = nonlinear_system(RICH), AnalyticPlant(RICH)
    times, torque = np.arange(0.0, 0.301, 0.01), np.array([2.0, -1.0, 0.5, 3.0])
    response = control.input_output_response(system, times, np.tile(torque[:, None], len(times)), 0)
    for _ in times[1:]:
        plant.step(torque)
    np.testing.assert_allclose(response.outputs[:6, -1], plant.motion(), atol=1e-4)


def test_parameters_of_the_system_are_those_of_the_model():
    system = nonlinear_system(RICH)
    heavy = {**system.params, "m0": 2 * system.params["m0"]}
    values = list(RICH.values())
    values[0] *= 2
    x, u = np.linspace(0.1, 1.0, 10), np.ones(4)
    wanted = np.asarray(rate_function(RICH)(0.0, x, u, values))[:, 0]
    np.testing.assert_allclose(system.dynamics(0.0, x, u, params=heavy), wanted)
    assert not np.allclose(system.dynamics(0.0, x, u), wanted)


def test_linear_system_is_the_derivative_of_the_nonlinear_one():
    linear, rates = linear_system(RICH, (0.3, 0.1, 0.2), yaw=0.4), rate_function(RICH)
    assert linear.state_labels == state_names(RICH) == nonlinear_system(RICH).state_labels
    # The held torques are found again: body velocities stay where they are.
    point = np.array([0.0, 0.0, 0.4, 0.3, 0.1, 0.2, *[0.0] * 4])
    point[6:] = u = _holding(nonlinear_system(RICH), point)
    for k in range(10):
        step = 1e-6 * np.eye(10)[k]
        up, down = (
            np.asarray(rates(0.0, point + s * step, u, RICH.values()))[:, 0] for s in (1, -1)
        )
        np.testing.assert_allclose(linear.A[:, k], (up - down) / 2e-6, atol=1e-3)


def _holding(system, point):
    """Smallest settled torques that keep the body velocity, by Newton's method."""
    u = np.zeros(4)
    for _ in range(5):

        def change(torque):
            return system.dynamics(0.0, np.concatenate([point[:6], torque]), torque)[3:6]

        slope = np.stack([(change(u + e) - change(u - e)) / 2e-4 for e in 1e-4 * np.eye(4)], axis=1)
        u = u - np.linalg.pinv(slope) @ change(u)
    return u


def test_translation_alone_has_the_time_constants_of_the_paper():
    poles = np.sort(-linear_system(PAPER).poles().real)
    # Friction over inertia: 0.24 s forward, 0.11 s sideways, 0.14 s in yaw.
    np.testing.assert_allclose(1 / poles[3:], [0.24, 0.14, 0.11], atol=0.006)
    np.testing.assert_allclose(poles[:3], 0.0, atol=1e-9)


def test_a_delay_is_refused_with_the_remedy():
    with pytest.raises(ValueError, match=r"actuator_delay.*control\.pade"):
        nonlinear_system(PAPER.with_effects({"actuator_delay": 0.02}))
