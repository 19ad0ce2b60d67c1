"""Controllers: physics of their models, tracking, the protocol, and what they may not see."""

import ast
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import youbot_env
from controllers import controller_names, make
from controllers.estimator import Estimator
from controllers.inverse import drive_command, required_wrench, shaft_torque
from controllers.preview import preview_weights
from youbot_env.backend import FLOAT
from youbot_env.envs.task import TrackingTask
from youbot_env.model_file import load_model
from youbot_env.plant import ModelStructure
from youbot_env.references import make_reference
from youbot_env.simulation import AnalyticPlant, Sensors

gym.register_envs(youbot_env)

PAPER, NOMINAL = load_model("paper"), load_model("nominal")
CLOSED_FORM = ("kinematic", "computed_torque", "lqr", "adaptive")
HARD = {
    "actuator_delay": 0.023,
    "actuator_lag": 0.03,
    "wheel_coulomb_friction": 0.2,
    "torque_offset": 0.1,
}


def drive(controller, robot=PAPER, reference="eight", frequency=1.0, steps=700, settle=300, **kw):
    """Rms position error, m, and yaw error, rad, of a run after ``settle`` steps."""
    env_id = kw.pop("env_id", "YouBot-v0")
    path = make_reference(reference, frequency=frequency, speed=0.3)
    env = gym.make(env_id, model=robot, reference=path, **controller.env_kwargs, **kw)
    seen, _ = env.reset(seed=1, options={"offset": (0, 0, 0), "follow": True})
    state, start, errors = None, True, []
    for _ in range(steps):
        action, state = controller.predict(seen, state, start)
        seen, _, lost, _, info = env.step(action)
        start = False
        assert not lost
        errors.append(info["pose"] - info["reference_pose"])
    gap = np.array(errors[settle:])
    return np.sqrt((gap[:, :2] ** 2).sum(axis=1).mean()), np.sqrt((gap[:, 2] ** 2).mean())


# Physics


@pytest.mark.parametrize(
    "effects",
    [
        {},
        {"wheel_coulomb_friction": 0.2, "roller_coulomb_friction": 0.01, "floor_slope": None},
        {"torque_gain": None, "torque_dead_zone": 0.2, "torque_offset": 0.1},
        {"load_dependent_friction": 0.2, "wheel_slip": 0.9},
        {"wheel_radius_error": None, "roller_angle_error": None},
        {"payload_change": None, "battery_sag": None},
    ],
    ids=lambda effects: "+".join(effects) or "none",
)
def test_inverse_dynamics_inverts_the_forward_dynamics(effects):
    model = PAPER.with_effects(effects)
    structure = ModelStructure.of(model)
    robot, rng = structure.bind(model.values()), np.random.default_rng(0)
    for _ in range(20):
        v, wanted = (tuple(rng.uniform(-0.4, 0.4, 3).tolist()) for _ in range(2))
        state = structure.rest((0.1, 0.2, 0.3), v)
        s = robot.signals(70.0, v, state.pose, state.wheel_angle, (0.0,) * 4, FLOAT)
        torque = shaft_torque(robot, required_wrench(s, wanted), s, state.internal, FLOAT)
        command = drive_command(robot, torque, s, state.internal, 0.01, 20.0, FLOAT)
        s = robot.signals(70.0, v, state.pose, state.wheel_angle, command, FLOAT)
        delivered, internal = robot.deliver(s, state.internal, 0.01, FLOAT)
        got = robot.acceleration(robot.wrench(delivered, s, internal, FLOAT), s)
        np.testing.assert_allclose(got, wanted, atol=2e-3)
        if not effects:
            assert command[0] + command[1] - command[2] - command[3] == pytest.approx(0, abs=1e-9)


def test_delay_and_lag_are_bridged_by_simulating_the_commands_on_their_way():
    model = PAPER.with_effects({"actuator_delay": 0.034, "actuator_lag": 0.04})
    task = TrackingTask(PAPER.platform, dt=0.01, preview=5, preview_stride=1)
    estimator, plant = Estimator(model, task), AnalyticPlant(model, 0.01)
    estimate, values, weights = estimator.build(), model.values(), estimator.weights(model)
    commands = np.random.default_rng(0).uniform(-3, 3, (12, 4))
    memory, start = np.zeros(estimator.size), (0.2, -0.1, 0.3)
    plant.reset(velocity=start)
    for command in commands:
        motion = plant.motion()
        # The reference stands at the origin: the error is minus the pose, in the robot's frame.
        c, s = np.cos(motion[2]), np.sin(motion[2])
        error = [-c * motion[0] - s * motion[1], s * motion[0] - c * motion[1], -motion[2]]
        seen = np.concatenate([error, motion[3:6], [c, s], np.zeros(18)])
        _, ahead, _, _, _, memory = estimate(seen, motion[2], memory, values, weights)
        memory = estimator.remember(np.asarray(memory)[:, 0], command)
        plant.step(command)
    # The last command acts 34 ms after it was given; until then the motion was settled before.
    fine = AnalyticPlant(model, 0.001)
    fine.reset(velocity=start)
    for tick in range(110 + 34):
        fine.step(commands[min(tick // 10, len(commands) - 1)])
    np.testing.assert_allclose(np.asarray(ahead)[:6, 0], fine.motion(), atol=1e-5)


def test_preview_weights_are_exact_for_cubic_motions_and_hold_beyond_the_end():
    task = TrackingTask(PAPER.platform, dt=0.01, preview=6, preview_stride=2)
    nodes, times = np.array(task.preview_times), np.array([0.0, 0.033, 0.117])
    cubic = np.polynomial.Polynomial([0.3, -1.0, 4.0, 20.0])
    np.testing.assert_allclose(preview_weights(task, times) @ cubic(nodes), cubic(times))
    rates = preview_weights(task, times, 1) @ cubic(nodes)
    np.testing.assert_allclose(rates, cubic.deriv()(times), atol=1e-9)
    assert preview_weights(task, [9.0]) @ cubic(nodes) == pytest.approx(cubic(nodes[-1]))


# Tracking


@pytest.mark.parametrize("frequency", [0.5, 1.5, 3.0])
def test_torque_controllers_with_the_true_model_beat_the_kinematic_one_five_times(frequency):
    kinematic, _ = drive(make("kinematic", PAPER), frequency=frequency)
    informed, _ = drive(make("computed_torque", PAPER), frequency=frequency)
    assert 5 * informed < kinematic


def test_every_effect_in_the_model_helps():
    for effects in (HARD, {"torque_dead_zone": 0.2, "floor_slope": None}, {"torque_gain": None}):
        robot = PAPER.with_effects(effects)
        # Without the observed disturbance, which would make up for most of what is missing.
        models = (make("computed_torque", m, disturbance_time=np.inf) for m in (robot, PAPER))
        informed, ignorant = (drive(controller, robot)[0] for controller in models)
        assert 10 * informed < ignorant


@pytest.mark.parametrize("name", ["computed_torque", "lqr", "mpc"])
def test_a_force_that_the_model_lacks_is_learned_and_compensated(name):
    robot = PAPER.with_effects({"cable_tether": {"k": 0.0, "fx": 15.0, "fy": -10.0}})
    observing = drive(make(name, PAPER), robot)[0]
    trusting = drive(make(name, PAPER, disturbance_time=np.inf), robot)[0]
    assert 3 * observing < trusting


def test_the_disturbance_is_the_force_in_the_frame_of_the_robot_and_does_not_wind_up():
    robot = PAPER.with_effects({"torque_offset": 0.3})
    task = TrackingTask(PAPER.platform, dt=0.01, preview=2, preview_stride=1)
    estimator, plant = Estimator(PAPER, task, disturbance_time=0.1), AnalyticPlant(robot, 0.01)
    estimate, weights = estimator.build(), estimator.weights(PAPER)
    memory, command, pushes = np.zeros(estimator.size), np.full(4, 4.0), []
    for _ in range(100):  # at the torque limit all the time
        x, y, yaw, *velocity = plant.motion().copy()
        c, s = np.cos(yaw), np.sin(yaw)
        error = [-c * x - s * y, s * x - c * y, -yaw]
        seen = np.concatenate([error, velocity, [c, s], np.zeros(9)])
        *_, push, memory = estimate(seen, yaw, memory, PAPER.values(), weights)
        memory = estimator.remember(np.asarray(memory)[:, 0], command)
        pushes.append(np.asarray(push)[:, 0])
        plant.step(command)
    # The log shows 0.3 N m more than the wheels get.
    wrench = PAPER.platform.jacobian_array.T @ np.full(4, -0.3)
    np.testing.assert_allclose(pushes[-1], wrench, rtol=0.02, atol=0.1)
    assert np.abs(pushes).max(axis=0)[0] < 1.01 * abs(wrench[0])


def test_learned_masses_do_not_reach_the_gain_of_the_observer():
    task = TrackingTask(PAPER.platform, dt=0.01, preview=2, preview_stride=1)
    estimator = Estimator(PAPER, task, disturbance_time=0.1)
    estimate, weights, heavy = estimator.build(), estimator.weights(PAPER), np.array(PAPER.values())
    heavy[0] *= 3
    memory, seen = np.zeros(estimator.size), np.zeros(8 + 9)
    memory[0] = 1.0
    seen[[3, 6]] = 0.1, 1.0  # at rest before, without a command
    pushes = [estimate(seen, 0.0, memory, v, weights)[4] for v in (PAPER.values(), heavy)]
    np.testing.assert_allclose(*map(np.asarray, pushes))
    share = 1 - np.exp(-0.01 / 0.1)
    inertia = PAPER.values()[0] + 4 * PAPER.values()[2] / PAPER.platform.wheel_radius**2
    assert float(pushes[0][0]) == pytest.approx(share * 0.1 * inertia / 0.01)


def test_smoothing_the_pose_costs_nothing_where_nothing_is_noisy():
    smoothed, plain = (drive(make("computed_torque", PAPER, pose_time=t))[0] for t in (0.2, 0.0))
    assert smoothed == pytest.approx(plain, abs=2e-5)


def test_adaptive_control_learns_what_the_nominal_model_lacks():
    adaptive, sensors = make("adaptive", NOMINAL), Sensors()
    learned = drive(adaptive, steps=1000, settle=500, sensors=sensors)[0]
    # The fixed controller without its observer too, as the adaptive one has none.
    fixed = drive(make("computed_torque", NOMINAL, disturbance_time=np.inf), sensors=sensors)[0]
    assert 10 * learned < fixed
    estimate = dict(zip(PAPER.names(), adaptive.estimate(adaptive._memory)[0], strict=True))
    truth = dict(zip(PAPER.names(), PAPER.values(), strict=True))
    for name, tolerance in (("mu1", 0.01), ("mu2", 0.01), ("m0", 0.1), ("I0", 0.1), ("may", 0.2)):
        assert estimate[name] == pytest.approx(truth[name], rel=tolerance)


def test_adaptive_control_returns_to_its_model_where_nothing_excites():
    adaptive = make("adaptive", NOMINAL, forgetting_time=0.5)
    drive(adaptive, reference="eight", steps=200, settle=0)
    memory = np.array(adaptive._memory)
    assert not np.allclose(adaptive.estimate(memory), NOMINAL.values(), rtol=0.05)
    still = np.zeros((1, adaptive.task.observation_space.shape[0]))
    still[:, 6] = 1.0
    for _ in range(2000):
        _, memory = adaptive.predict(still, memory)
    np.testing.assert_allclose(adaptive.estimate(memory)[0], NOMINAL.values(), rtol=0.01, atol=0.01)


@pytest.mark.parametrize("reference", ["circle", "eight"])
def test_real_rollers_within_ten_millimetres_and_one_degree(reference):
    position, yaw = drive(
        make("computed_torque", PAPER), reference=reference, frequency=0.5,
        env_id="YouBotRollers-v0", steps=450, settle=150,
    )  # fmt: skip
    assert position < 0.010
    assert np.degrees(yaw) < 1.0


def test_lqr_gains_stabilise_the_errors_at_velocities_between_the_nodes():
    from scipy.linalg import expm

    from controllers.lqr import error_dynamics

    controller, rng = make("lqr", PAPER), np.random.default_rng(0)
    assert drive(controller)[0] < 1e-4
    slopes = error_dynamics(ModelStructure.of(PAPER))
    for twist in rng.uniform(-1, 1, (20, 3)) * (0.8, 0.8, 3.2):
        a, b = (np.asarray(part) for part in slopes(twist, PAPER.values()))
        held = expm(np.block([[a, b], [np.zeros((4, 10))]]) * 0.01)
        closed = held[:6, :6] + held[:6, 6:] @ controller.gain(twist[None])[0]
        assert np.abs(np.linalg.eigvals(closed)).max() < 0.99


# Protocol


@pytest.mark.parametrize("name", CLOSED_FORM)
def test_a_batch_is_its_robots_one_by_one(name):
    controller, alone = make(name, PAPER.with_effects(HARD)), make(name, PAPER.with_effects(HARD))
    rng, robots = np.random.default_rng(0), 3
    space = controller.task.observation_space
    states, single = None, [None] * robots
    for step in range(6):
        seen = 0.1 * rng.uniform(-1, 1, (robots, space.shape[0])).astype(np.float32)
        seen[:, 6:8] = (0.8, 0.6)
        starts = np.array([step == 0, step in (0, 3), step == 0])
        actions, states = controller.predict(seen, states, starts)
        assert actions.shape == (robots, *controller.task.action_space.shape)
        assert actions.dtype == np.float32
        for i in range(robots):
            action, single[i] = alone.predict(seen[i], single[i], starts[i])
            np.testing.assert_allclose(action, actions[i], atol=1e-6)
            np.testing.assert_allclose(single[i], states[i], atol=1e-6)


@pytest.mark.parametrize("name", controller_names())
def test_evaluate_policy_runs_every_controller(name):
    evaluation = pytest.importorskip("stable_baselines3.common.evaluation")
    from stable_baselines3.common.vec_env import DummyVecEnv

    try:
        controller = make(name, PAPER)
    except ValueError as error:
        if "no policy" not in str(error):
            raise
        pytest.skip(str(error))

    def build():
        return gym.make("YouBot-v0", max_episode_steps=40, **controller.env_kwargs)

    mean, spread = evaluation.evaluate_policy(
        controller, DummyVecEnv([build, build]), n_eval_episodes=4, warn=False
    )
    # Reward is at most one a step; the start offset costs the first half second.
    assert 20 < mean <= 40
    assert spread < 10


def test_without_a_state_the_controller_remembers_until_reset():
    robot = PAPER.with_effects(HARD)
    controller, explicit = make("computed_torque", robot), make("computed_torque", robot)
    seen = np.zeros(controller.task.observation_space.shape)
    seen[[0, 6]] = 0.05, 1.0
    state, first = None, controller.predict(seen)[0]
    for step in range(5):
        wanted, state = explicit.predict(seen, state, step == 0)
        got = first if step == 0 else controller.predict(seen)[0]
        np.testing.assert_array_equal(got, wanted)
    controller.reset()
    np.testing.assert_array_equal(controller.predict(seen)[0], first)


def test_another_model_with_the_same_effects_compiles_nothing():
    controller = make("computed_torque", NOMINAL)
    law = controller.law
    controller.set_model(PAPER)
    assert controller.law is law
    controller.set_model(PAPER.with_effects({"torque_offset": 0.1}))
    extended = controller.law
    assert extended is not law
    controller.set_model(NOMINAL)
    assert controller.law is law
    controller.set_model(NOMINAL.with_effects({"torque_offset": 0.2}))
    assert controller.law is extended


def test_bad_requests_name_the_value_and_the_remedy():
    with pytest.raises(ValueError, match=r"'kinematics'.*did you mean 'kinematic'.*lqr"):
        make("kinematics", PAPER)
    with pytest.raises(TypeError, match=r"\['gain'\].*position_gain"):
        make("kinematic", PAPER, gain=2.0)
    with pytest.raises(ValueError, match="bandwidth = -1"):
        make("computed_torque", PAPER, bandwidth=-1)
    with pytest.raises(ValueError, match=r"pose_time = -1"):
        make("lqr", PAPER, pose_time=-1)
    with pytest.raises(ValueError, match=r"disturbance_time = 0; .*inf"):
        make("mpc", PAPER, disturbance_time=0)
    with pytest.raises(ValueError, match=r"preview = 1 .* at least 2 "):
        make("computed_torque", PAPER, preview=1)
    with pytest.raises(ValueError, match=r"preview = 5 .* at least 11 .* 0\.1 s"):
        make("lqr", PAPER.with_effects({"actuator_delay": 0.1}), preview=5)
    controller = make("computed_torque", PAPER)
    with pytest.raises(ValueError, match=r"\(\.\.\., 71\).*env_kwargs"):
        controller.predict(np.zeros(11))
    seen = np.zeros(71)
    seen[4] = np.nan
    with pytest.raises(ValueError, match=r"observation\[0, 4\] = nan"):
        controller.predict(seen)
    with pytest.raises(ValueError, match=r"state has shape \(1, 3\)"):
        controller.predict(np.zeros(71), np.zeros(3))
    from dataclasses import replace

    from youbot_env.platform import omni3

    with pytest.raises(ValueError, match="omni3"):
        controller.set_model(replace(PAPER, platform=omni3()))


def test_controllers_see_observations_and_a_model_and_nothing_of_the_true_robot():
    folder = Path(__file__).parents[1] / "controllers"
    forbidden = {"unwrapped", "true_parameters", "reveal_parameters", "measurement", "env"}
    forbidden |= {"AnalyticPlant", "RollersPlant", "TrackingEnv", "gymnasium"}
    forbidden |= {"controllers.evaluation", "evaluation", "Subject"}
    # The rooms that drive controllers hold true robots; no controller may enter them.
    rooms = {"evaluation", "training"}
    forbidden |= {"controllers.training"}
    files = [file for file in folder.rglob("*.py") if not rooms & set(file.parts)]
    assert len(files) > 5
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = {getattr(node, "id", None), getattr(node, "attr", None)}
            names |= {getattr(node, "arg", None)}
            if isinstance(node, ast.Import | ast.ImportFrom):
                for alias in node.names:
                    names |= {alias.name.split(".")[0], alias.name}
                module = getattr(node, "module", None) or ""
                names |= {module.split(".")[0], ".".join(module.split(".")[:2])}
            assert not names & forbidden, f"{file.name} uses {names & forbidden}"
