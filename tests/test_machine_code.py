"""Machine code for many robots: the trace is what the law says, and nothing unsafe is loaded."""

import copy
import os
import pickle
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import youbot_env
from youbot_env.backend import NUMPY
from youbot_env.effects import Parameter, effect_names, get_effect
from youbot_env.effects.base import Effect
from youbot_env.envs import robots
from youbot_env.envs.noise import noise_block
from youbot_env.envs.randomization import Independent, Posterior
from youbot_env.model import ActiveEffect
from youbot_env.model_file import load_model
from youbot_env.native import build
from youbot_env.native.emit import PRELUDE, Array, Output, function_text, read
from youbot_env.native.trace import Graph, NotTraceable, tracing_ops
from youbot_env.references import Circle, Joystick, Multisine
from youbot_env.simulation import Sensors

gym.register_envs(youbot_env)

PAPER = load_model("paper")
LAWS = [name for name in effect_names() if get_effect(name).link != "sensor"]
GROUPS = [LAWS[k::7] for k in range(7)]
WIDE = Independent({"a_x": ("uniform", -0.5, 0.5), "m0": ("normal", 30.0, 6.0)})


@pytest.fixture
def compiler():
    try:
        build.load(PRELUDE)
    except build.NoCompiler as error:
        pytest.skip(f"no machine code here: {error}")


def many(copies=3, **arguments):
    return gym.make_vec(
        "YouBot-v0", copies, vectorization_mode="vector_entry_point", **arguments
    ).unwrapped


def largest_difference(steps, mode=AutoresetMode.NEXT_STEP, copies=3, size=1.0, **arguments):
    """Of observation, reward and pose between copies in machine code and single environments."""
    native = many(copies, autoreset_mode=mode, **arguments)
    assert isinstance(native._robots, robots.CompiledRobots)
    single = gym.make_vec(
        "YouBot-v0", copies, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode},
        **arguments,
    )  # fmt: skip
    rng, largest = np.random.default_rng(1), 0.0
    ours, theirs = native.reset(seed=5), single.reset(seed=5)
    for _ in range(steps):
        for one, other in (
            (ours[0], theirs[0]),
            (ours[1], theirs[1]) if len(ours) > 2 else (0.0, 0.0),
            (ours[-1]["pose"], theirs[-1]["pose"]),
        ):
            largest = max(largest, float(np.abs(np.asarray(one, float) - other).max()))
        actions = size * rng.uniform(-1, 1, native.action_space.shape)
        ours, theirs = (
            native.step(actions.astype(np.float32)),
            single.step(actions.astype(np.float32)),
        )
        np.testing.assert_array_equal(ours[2], theirs[2])
        np.testing.assert_array_equal(ours[3], theirs[3])
    return largest


@pytest.mark.parametrize("names", GROUPS, ids=lambda names: "+".join(names)[:40])
def test_every_effect_is_the_one_of_the_single_environment(names, compiler):
    model = PAPER.with_effects(dict.fromkeys(names))
    assert largest_difference(40, model=model, max_episode_steps=25) < 1e-6


@pytest.mark.parametrize("mode", list(AutoresetMode)[:2])
def test_all_at_once_over_a_second_and_a_half(mode, compiler):
    model = PAPER.with_effects(
        {"actuator_delay": 0.013, "actuator_lag": 0.03, "wheel_coulomb_friction": 0.2}
    )
    spread = Independent({"m0": ("scale", 0.8, 1.2), "actuator_delay.d": ("uniform", 0.0, 0.05)})
    difference = largest_difference(
        150, mode, model=model, randomization=spread, sensors=Sensors(), max_episode_steps=70,
        reference=Multisine(speed=(0.1, 0.5), frequency=(0.3, 2.0)),
    )  # fmt: skip
    assert difference < 1e-6


def test_numbers_do_not_run_away_over_a_whole_episode(compiler):
    assert largest_difference(1100, size=0.3, reference=Circle(speed=0.02)) < 1e-6


@pytest.mark.parametrize(
    "reference",
    [Circle(random_phase=True), Joystick(speed=(0.1, 0.3)), "square", "smooth_random", "step"],
    ids=str,
)
def test_references_are_those_of_the_single_environment(reference, compiler):
    assert largest_difference(70, reference=reference, max_episode_steps=30) < 1e-6


@pytest.mark.parametrize("compiled", [True, False])
def test_impossible_robots_are_drawn_again_as_in_the_single_environment(compiled):
    env = many(40, randomization=WIDE, compiled=compiled, reveal_parameters=True)
    drawn = env.reset(seed=3)[1]["true_parameters"]
    for k in range(40):
        single = gym.make("YouBot-v0", randomization=WIDE, reveal_parameters=True)
        own = single.reset(seed=3 + k)[1]["true_parameters"]
        for name, value in own.items():
            assert drawn[name][k] == pytest.approx(value, rel=3e-6, abs=3e-6)


def test_posterior_and_a_randomization_of_ones_own_agree_with_single_environments():
    from dataclasses import replace

    from youbot_env.envs.randomization import Randomization

    class Own(Randomization):
        def propose(self, model, rng):
            return model.with_values([v * rng.uniform(0.9, 1.1) for v in model.values()])

    covariance = np.diag((0.01 * np.abs(PAPER.values())) ** 2).tolist()
    for randomization in (Posterior(), Own()):
        known = replace(PAPER, covariance=covariance)
        arguments = {"model": known, "randomization": randomization, "reveal_parameters": True}
        drawn = many(2, **arguments).reset(seed=1)[1]["true_parameters"]["mu1"]
        own = gym.make("YouBot-v0", **arguments).reset(seed=2)[1]["true_parameters"]["mu1"]
        assert drawn[1] == pytest.approx(own, rel=1e-6)


@pytest.mark.parametrize("how", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("compiled", [True, False])
def test_a_copy_goes_on_bit_by_bit(how, compiled):
    env = many(
        5, compiled=compiled, sensors=Sensors(), reference="multisine", max_episode_steps=30,
        action_level="velocity",
    )  # fmt: skip
    env.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1, 1, (60, 5, 3)).astype(np.float32)
    for action in actions[:20]:
        env.step(action)
    other = how(env)
    told = [[e.step(a)[0].copy() for a in actions[20:]] for e in (other, env)]
    np.testing.assert_array_equal(*told)


def test_what_was_returned_before_stays_as_it_was():
    env = many(4)
    env.reset(seed=0)
    first = env.step(np.ones((4, 4), np.float32))
    kept = copy.deepcopy(first)
    for _ in range(3):
        env.step(-np.ones((4, 4), np.float32))
    for one, other in zip(first[:4], kept[:4], strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(first[4]["pose"], kept[4]["pose"])


def test_noise_is_normal_and_of_one_step_at_a_time():
    scale = np.ones(6)
    blocks = [noise_block(scale, (k, 77), 64 * b) for k in range(60) for b in range(10)]
    drawn = np.concatenate(blocks)
    count = len(drawn)
    assert np.abs(drawn.mean(axis=0)).max() < 4 / np.sqrt(count)
    np.testing.assert_allclose(np.cov(drawn.T), np.eye(6), atol=5 / np.sqrt(count))
    np.testing.assert_allclose((drawn**4).mean(axis=0), 3.0, atol=4 * np.sqrt(96 / count))
    lag = (drawn[1:] * drawn[:-1]).mean(axis=0)
    assert np.abs(lag).max() < 4 / np.sqrt(count)


def test_without_a_compiler_it_goes_on_and_says_once_what_would_help(monkeypatch):
    def none():
        raise build.NoCompiler("no C compiler (cc, gcc, clang) is on the path")

    monkeypatch.setattr(build, "_compiler", none)
    monkeypatch.setattr(robots, "_told", set())
    with pytest.warns(UserWarning, match="no C compiler.*gcc or clang"):
        env = many()
    assert isinstance(env._robots, robots.ArrayRobots)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again = many()
    np.testing.assert_array_equal(env.reset(seed=0)[0], again.reset(seed=0)[0])


class Asking(Effect):
    identifier, title, equation, link = "asking", "Asks", "", "body"
    parameters = (Parameter("c", "N", "force", 1.0, (0.0, 2.0)),)

    def body(self, p, s, ops):
        return (p.c if s.v[0] > 0 else -p.c), 0.0, 0.0


def test_a_law_that_cannot_be_traced_is_named(monkeypatch, compiler):
    monkeypatch.setattr(robots, "_told", set())
    from dataclasses import replace

    model = replace(PAPER, effects=(ActiveEffect(Asking(), {"c": 1.0}),))
    with pytest.warns(UserWarning, match=r"asks whether a value is true; use ops\.where"):
        env = many(model=model)
    assert isinstance(env._robots, robots.ArrayRobots)
    node = Graph().uniform(0)
    with pytest.raises(NotTraceable, match=r"whether a value is true; use ops\.where"):
        bool(node)


def traced(function, arguments, kind):
    """Values of a traced function of arrays, one output."""
    graph = Graph()
    ops, count = tracing_ops(graph), len(arguments[0])
    nodes = [read(graph, Array(1 + k, kind))[0] for k in range(len(arguments))]
    slot = 1 + len(arguments)
    output = Output(Array(slot, "d"), 0, graph.wrap(function(*nodes, ops)))
    library = build.load(PRELUDE + function_text("f", graph, [output], False))
    width = -(-count // 64) * 64
    dtype = {"d": np.float64, "f": np.float32}[kind]
    data = [np.resize(np.asarray(a, dtype), width) for a in arguments]
    result = np.zeros(width)
    pointers = np.array([0, *(a.ctypes.data for a in data), result.ctypes.data], np.uint64)
    sizes = np.array([count, width, 0], np.int64)
    library.f(*(np.ctypeslib.as_ctypes(a) for a in (pointers, np.zeros(1), sizes)))
    return result[:count]


SPAN = np.linspace(-30.0, 30.0, 20_001)
ELEMENTARY = {
    "sin": (SPAN, 1.5e-7), "cos": (SPAN, 1.5e-7), "tanh": (SPAN, 4e-7),
    "log": (np.geomspace(1e-30, 1e30, 20_001), 2e-7), "exp": (SPAN, 3e-7),
    "sqrt": (SPAN + 30.0, 1e-7), "floor": (SPAN, 0.0), "abs": (SPAN, 0.0), "sign": (SPAN, 0.0),
    "tan": (np.linspace(-1.5, 1.5, 2001), 1e-6),
}  # fmt: skip


@pytest.mark.parametrize("name", ELEMENTARY)
def test_elementary_functions_have_the_stated_error(name, compiler):
    x, bound = ELEMENTARY[name]
    x = x.astype(np.float32).astype(float)
    found, exact = traced(lambda a, ops: getattr(ops, name)(a), [x], "f"), getattr(np, name)(x)
    assert np.abs((found - exact) / np.maximum(1.0, np.abs(exact))).max() <= bound


def test_angles_in_double_precision_stay_exact_when_they_are_large(compiler):
    x = np.linspace(-1e6, 1e6, 10_001)
    for name in ("sin", "cos"):
        found = traced(lambda a, ops, name=name: getattr(ops, name)(a), [x], "d")
        np.testing.assert_allclose(found, getattr(np, name)(x), atol=1.5e-7)


def test_loops_powers_and_choices_are_those_of_numpy(compiler):
    def function(a, b, ops):
        def turn(carry):
            x, (y, n) = carry
            return x * 0.9 + b, (ops.where(x > y, y + 0.25, y), n + 1.0)

        x, (y, n) = ops.iterate(5, turn, (a, (b, 0.0)))
        z, _ = ops.iterate(3, turn, (x * y, (a, n)))
        chosen = ops.where((a > 0.0) & (b < 1.0) | (z > 9.0), x**3 + y**-0.5, ops.minimum(z, y))
        return chosen + (1.0 + a * a) ** 0.7 - ops.maximum(-n, x) / 7.0

    rng = np.random.default_rng(0)
    a, b = rng.uniform(-1, 2, 1000), rng.uniform(0.1, 2, 1000)
    expected = function(a, b, NUMPY)
    np.testing.assert_allclose(traced(function, [a, b], "d"), expected, rtol=2e-6, atol=2e-6)


def test_constants_are_folded_and_equal_expressions_are_one():
    graph = Graph()
    ops = tracing_ops(graph)
    (a,) = read(graph, Array(1, "f"))
    assert graph.call("add", 2.0, graph.call("mul", 3.0, 4.0)).value == 14.0
    assert a * 1.0 is a
    assert a + 0.0 is a
    assert (a * 0.0).value == 0.0
    assert a * 2.0 is 2.0 * a or (a * 2.0).op == "mul"
    assert ops.tanh(a + 1.0) is ops.tanh(a + 1.0)
    before = len(graph.nodes)
    ops.tanh(a + 1.0)
    assert len(graph.nodes) == before


def test_nothing_is_loaded_that_others_could_have_written(tmp_path, monkeypatch, compiler):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = build.cache_folder()
    assert folder.stat().st_mode & 0o777 == 0o700
    text = PRELUDE + "int forty_two(void) { return 42; } // " + str(tmp_path)
    assert build.load(text).forty_two() == 42
    (library,) = folder.glob("*.so")
    assert not list(folder.glob(".building*"))
    # A library that others may write to is built anew, not loaded.
    library.unlink()
    library.write_bytes(b"not a library")
    library.chmod(0o666)
    build._libraries.clear()
    assert build.load(text).forty_two() == 42
    assert library.stat().st_mode & 0o022 == 0
    # So is one behind a link; and a folder that others may write to is not used.
    other = tmp_path / "other.so"
    os.replace(library, other)
    library.symlink_to(other)
    assert not build.ours(library)
    folder.chmod(0o777)
    assert build.cache_folder() is None
    build._libraries.clear()
    assert build.load(text).forty_two() == 42


def test_a_compiler_that_fails_is_told(monkeypatch):
    monkeypatch.setenv("CC", "false")
    build._identity.cache_clear()
    with pytest.raises(build.NoCompiler, match="false fails"):
        build.load("int x;")
