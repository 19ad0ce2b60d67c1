"""Ripple of real rollers, fed forward by the wheel angles that encoders show."""

import gymnasium as gym
import numpy as np
import pytest

import youbot_env
from controllers import make
from controllers.evaluation.motions import Motion
from controllers.evaluation.run import drive, make_env, measure
from controllers.evaluation.subjects import Subject
from youbot_env.model_file import load_model

gym.register_envs(youbot_env)

PAPER = load_model("paper")
RIPPLED = PAPER.with_effects({"roller_ripple": {"size": 0.8}})
DELAYED = RIPPLED.with_effects({"actuator_delay": 0.013, "wheel_coulomb_friction": 0.2})


def velocity_error(controller, model, **settings):
    """Rms velocity error, m/s, on a slow circle on real rollers."""
    robot = Subject("rollers", 0, PAPER, 0)
    driver = make(controller, model, **settings)
    env, motion = make_env(robot, driver), Motion("circle", 0.5, length=4.0)
    trace = drive(driver, env, motion, 0)
    env.close()
    return measure(trace, 0.01, 4.0, motion.speed)["velocity"]


def test_the_ripple_of_real_rollers_is_fed_forward():
    """Measured: 13.5 mm/s kinematic, 9.9 with ideal wheels believed, 4.5 with ripple."""
    pytest.importorskip("mujoco")
    kinematic, plain = velocity_error("kinematic", PAPER), velocity_error("computed_torque", PAPER)
    rippled = velocity_error("computed_torque", RIPPLED)
    assert rippled < 0.7 * plain
    assert rippled < 0.5 * kinematic


@pytest.mark.parametrize("name", ["computed_torque", "lqr", "adaptive", "mpc"])
def test_measured_angles_take_the_place_of_reckoned_ones(name):
    controller = make(name, DELAYED)
    assert controller.uses_wheel_angle
    seen, state = np.zeros((2, controller.task.observation_space.shape[0])), None
    seen[:, 6] = 1.0
    seen[:, 4] = seen[:, 9] = 0.3  # sideways
    angles = np.array([[0.1, 0.2, -0.1, -0.2], [0.5, 0.4, 0.3, 0.2]])
    estimator = controller.estimator
    wheels = slice(estimator.state.start + 6, estimator.state.start + 10)
    for step in range(3):
        told = angles + 0.05 * step
        action, state = controller.predict(seen, state, step == 0, wheel_angle=told)
        np.testing.assert_allclose(state[:, wheels], told, atol=1e-12)
    assert np.abs(action[0] - action[1]).max() > 1e-3
    # Once the encoders fall silent the angles are reckoned on from the last ones.
    silent = told.copy()
    silent[1, 2] = np.nan
    _, state = controller.predict(seen, state, wheel_angle=silent)
    np.testing.assert_allclose(state[0, wheels], told[0], atol=1e-12)
    moved = state[1, wheels] - told[1]
    assert (np.abs(moved) > 0.01).all()
    _, after = controller.predict(seen, state)
    assert (np.abs(after[:, wheels] - state[:, wheels]) > 0.01).all()


def test_true_angles_change_nothing_where_the_model_is_the_robot():
    controller, motion = make("computed_torque", DELAYED), Motion("eight", 1.0, length=1.0)
    robot, errors = Subject("analytic", 0, DELAYED, 0), []
    env, predict = make_env(robot, controller), controller.predict
    for told in (True, False):
        if not told:
            controller.predict = lambda *given, wheel_angle, predict=predict: predict(*given)
        errors.append(drive(controller, env, motion, 0).error)
    np.testing.assert_allclose(errors[0], errors[1], atol=1e-6)
    assert np.abs(errors[0][:, :2]).max() < 1e-4


def test_models_without_wheel_angles_ignore_them_and_shapes_are_checked():
    for name in ("kinematic", "computed_torque", "ppo"):
        controller = make(name, PAPER)
        assert not controller.uses_wheel_angle
        seen = np.zeros(controller.task.observation_space.shape)
        seen[6] = 1.0
        plain, state = controller.predict(seen, None, True)
        told, same = controller.predict(seen, None, True, wheel_angle=np.full(4, 0.3))
        np.testing.assert_array_equal(plain, told)
        np.testing.assert_array_equal(state, same)
        with pytest.raises(ValueError, match=r"wheel_angle has shape \(1, 3\).*\(1, 4\)"):
            controller.predict(seen, wheel_angle=np.zeros(3))


@pytest.mark.parametrize("env_id", ["YouBot-v0", "YouBotRollers-v0"])
def test_the_environments_show_what_encoders_show(env_id):
    if "Rollers" in env_id:
        pytest.importorskip("mujoco")
    env = gym.make(env_id, model=PAPER)
    env.reset(seed=0, options={"offset": (0, 0, 0)})
    np.testing.assert_array_equal(env.unwrapped.wheel_angle, 0.0)
    for _ in range(20):
        *_, info = env.step(np.full(4, 0.5, np.float32))
    angle = env.unwrapped.wheel_angle
    # Forward as far as the wheels roll.
    np.testing.assert_allclose(angle * 0.0475, np.hypot(*info["pose"][:2]), rtol=0.1)
