"""What is written comes back equal: models, motions, logs, policies of any values."""

import tempfile
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from foreign_logs import make
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from controllers.rl_features import NAMES
from controllers.rl_policy import Policy
from ident.log import CHANNELS, Log
from ident.remembered import remember
from youbot_env.effects import effect_names, get_effect
from youbot_env.model import Model
from youbot_env.model_file import load_model, save_model
from youbot_env.parameters import Parameters
from youbot_env.platform import mecanum, omni3, youbot
from youbot_env.references import Fourier, load_motion, save_motion

# Few, and always the same: the suite has no time for more.
FEW = {"derandomize": True, "deadline": None, "database": None,
       "phases": [Phase.explicit, Phase.generate],
       "suppress_health_check": [HealthCheck.too_slow]}  # fmt: skip
WORDS = st.text(st.characters(codec="utf-8", exclude_categories=["Cs", "Cc"]), max_size=20)
ANGLES = st.floats(-7.0, 7.0)


@contextmanager
def folder():
    """A folder of its own for each example."""
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


@st.composite
def platforms(draw):
    length = st.floats(0.05, 0.9)
    radius = draw(st.floats(0.02, 0.3))
    if draw(st.booleans()):
        return omni3(draw(length), radius, draw(st.floats(0.1, 0.9)) * radius)
    sizes = draw(length), draw(length), radius, draw(st.floats(0.1, 0.9)) * radius
    platform = mecanum(draw(WORDS) or "p", *sizes, draw(st.floats(0.1, 2.0)))
    turn = draw(ANGLES)
    wheels = tuple(replace(wheel, heading=wheel.heading + turn) for wheel in platform.wheels)
    turned = replace(platform, wheels=wheels)
    return turned if draw(st.booleans()) else platform


@st.composite
def models(draw):
    platform = draw(platforms())
    parameters = Parameters(
        m0=draw(st.floats(10.0, 1e3)), I0=draw(st.floats(0.1, 1e2)), I1=draw(st.floats(0.0, 1.0)),
        a_x=0.0, a_y=0.0, mu1=draw(st.floats(0.0, 10.0)), mu2=draw(st.floats(0.0, 1e-2)),
    )  # fmt: skip
    chosen = draw(st.lists(st.sampled_from(effect_names()), unique=True, max_size=3))
    effects = {}
    for name in chosen:
        parameter = get_effect(name).parameters[0]
        low, high = parameter.bounds
        usual = parameter.default
        # A choice is no number; sizes between the bounds make sense alone.
        inside = usual * draw(st.floats(0.5, 1.0))
        effects[name] = None if parameter.choices or not low <= inside <= high else inside
    model = Model(platform, parameters, name=draw(WORDS) or "m").with_effects(effects)
    if draw(st.booleans()):
        # Squares of smaller deviations would lose their digits.
        size = st.just(0.0) | st.floats(1e-9, 1.0)
        count = len(model.names())
        root = np.array(draw(st.lists(size, min_size=count, max_size=count)))
        model = replace(model, covariance=np.outer(root, root).tolist())
    errors = draw(st.dictionaries(st.sampled_from(["m0", "I0"]), st.floats(0.0, 10.0)))
    sources = {name: "" for name in parameters.as_dict()} | draw(
        st.dictionaries(st.sampled_from(["m0", "I0"]), WORDS)
    )
    history = draw(st.dictionaries(WORDS, WORDS | st.integers(0, 99) | st.none(), max_size=3))
    return replace(model, standard_errors=errors, sources=sources, provenance=history)


@settings(max_examples=40, **FEW)
@given(models())
def test_models(model):
    with folder() as place:
        save_model(model, place / "m.yaml")
        again = load_model(place / "m.yaml")
    sizes = [[(one.identifier, one.values) for one in m.effects] for m in (again, model)]
    assert sizes[0] == sizes[1]
    assert replace(again, effects=()) == replace(model, effects=())


@st.composite
def motions(draw):
    count = draw(st.integers(0, 4))
    rows = [
        [draw(st.lists(size, min_size=count, max_size=count)) for _ in range(3)]
        for size in (st.floats(-2.0, 2.0), ANGLES)
    ]
    amplitudes, phases = (tuple(tuple(row) for row in part) for part in rows)
    about = draw(st.dictionaries(WORDS, WORDS | st.floats(-1e9, 1e9), max_size=2))
    return Fourier(draw(st.floats(0.0, 3.0)), draw(st.floats(1e-3, 50.0)), amplitudes, phases,
                   draw(WORDS), about)  # fmt: skip


@settings(max_examples=40, **FEW)
@given(motions())
def test_motions(motion):
    with folder() as place:
        save_motion(motion, place / "m.yaml")
        again = load_motion(place / "m.yaml")
    assert again == motion
    assert again.about == motion.about


@settings(max_examples=10, **FEW)
@given(
    platform=st.sampled_from([youbot(), omni3(), mecanum("mine", 0.14, 0.13, 0.05, 0.012, 1.0)]),
    ending=st.sampled_from([".csv", ".parquet"]),
    begin=st.floats(0.0, 2e9),
    left_out=st.sets(st.sampled_from(["reference", "pose"]), max_size=2),
    held=st.sampled_from([{}, {"drive_hold": {"kind": 0.0}}]),
)
def test_logs(platform, ending, begin, left_out, held):
    good = make(320, platform=platform)
    good = replace(good, time=good.time + begin, recording=held, **dict.fromkeys(left_out))
    with folder() as place:
        first = Log.load(good.save(place / f"a{ending}", remember(good, "by hand")))
        again = Log.load(first.save(place / f"b{ending}", remember(first, "again")))
    for log in (first, again):
        for name in ("time", *CHANNELS):
            np.testing.assert_array_equal(getattr(log, name), getattr(good, name), name)
        assert log.platform.geometry == platform.geometry
        assert log.recording == held
        assert log.starts == good.starts
    assert {f.what for f in first.findings} == {f.what for f in again.findings}


@settings(max_examples=15, **FEW)
@given(
    sizes=st.lists(st.integers(1, 5), min_size=1, max_size=3),
    seed=st.integers(0, 2**32 - 1),
    clip=st.floats(1e-3, 1e3),
    activation=st.sampled_from(["tanh", "relu"]),
    squash=st.booleans(),
    share=st.floats(0.0, 4.0),
    training=st.dictionaries(WORDS, WORDS | st.floats(-1e9, 1e9) | st.booleans(), max_size=3),
)
def test_policies(sizes, seed, clip, activation, squash, share, training):
    rng, widths = np.random.default_rng(seed), [len(NAMES), *sizes]
    pairs = list(zip(widths[1:], widths[:-1], strict=True))
    policy = Policy(
        "ppo", tuple(rng.normal(size=pair).astype(np.float32) for pair in pairs),
        tuple(rng.normal(size=pair[0]).astype(np.float32) for pair in pairs),
        rng.normal(size=widths[0]), rng.uniform(0.1, 2.0, widths[0]), clip, activation, squash,
        share, {"dt": 0.01, "torque_limit": 4.0}, training,
    )  # fmt: skip
    with folder() as place:
        again = Policy.load(policy.save(place / "p.json"))
    for name in ("weights", "biases", "mean", "deviation"):
        for mine, read in zip(getattr(policy, name), getattr(again, name), strict=True):
            np.testing.assert_array_equal(read, mine)
    for name in ("algorithm", "clip", "activation", "squash", "share", "task", "training"):
        assert getattr(again, name) == getattr(policy, name)
