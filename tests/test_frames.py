"""Sources of body motion in wrong axes: never are good wheel columns rearranged to fit them."""

import numpy as np
import polars as pl
import pytest
from shared_data import shared
from spoiled_logs import M, P, R, V, both, exchange, good_frame, negate
from test_doctor import difference, load

from ident.log import Log
from youbot_env.platform import youbot

BODY = ["body_velocity_x", "body_velocity_y", "yaw_rate"]


def rotated(x: np.ndarray, y: np.ndarray, angle) -> tuple[np.ndarray, np.ndarray]:
    return np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y


def turn(degrees: float):
    """Turn the reference."""

    def spoil(f: pl.DataFrame) -> pl.DataFrame:
        x, y = rotated(f[R[0]].to_numpy(), f[R[1]].to_numpy(), np.deg2rad(degrees))
        return f.with_columns(pl.Series(R[0], x), pl.Series(R[1], y))

    return spoil


def heading(degrees: float):
    return lambda f: f.with_columns(pl.col("yaw") + np.deg2rad(degrees))


def with_body(f: pl.DataFrame, degrees: float = 0.0, signs=(1, 1, 1), world=False):
    """The log with a sensor of body velocities in place of pose and reference."""
    velocity = f.select(V).to_numpy() @ np.linalg.pinv(youbot().jacobian_array).T
    velocity += 0.005 * np.random.default_rng(5).standard_normal(velocity.shape)
    angle = np.deg2rad(degrees) + (f["yaw"].to_numpy() if world else 0.0)
    x, y = rotated(velocity[:, 0], velocity[:, 1], angle)
    columns = np.column_stack([x, y, velocity[:, 2]]) * signs
    made = [pl.Series(name, columns[:, k]) for k, name in enumerate(BODY)]
    return f.drop(P + R).with_columns(made)


def good_body() -> np.ndarray:
    return with_body(good_frame()).select(BODY).to_numpy()


WRONG_REFERENCE = {
    "axes exchanged": exchange((R[0], R[1])),
    "axes exchanged, yaw negated": both(exchange((R[0], R[1])), negate(R[2])),
    "yaw negated": negate(R[2]),
    "sideways negated": negate(R[1]),
    "turned by 90 deg": turn(90),
    "turned by -90 deg": turn(-90),
    "turned by 180 deg": turn(180),
    "turned by 45 deg": turn(45),
    "turned by 60 deg": turn(60),
}


@pytest.mark.parametrize("name", WRONG_REFERENCE)
def test_wrong_reference_alone_is_left_out(tmp_path, name):
    log = load(tmp_path, WRONG_REFERENCE[name](good_frame()).drop(P))
    assert difference(log) < 1e-5
    assert log.reference is None
    (told,) = log.findings
    assert told.severity == "warning"
    assert "left out" in told.remedy


@pytest.mark.parametrize("name", [n for n in WRONG_REFERENCE if "45" not in n and "60" not in n])
def test_wrong_reference_beside_a_pose_is_put_right(tmp_path, name):
    log = load(tmp_path, WRONG_REFERENCE[name](good_frame()))
    assert difference(log) < 1e-5
    np.testing.assert_allclose(log.reference, good_frame().select(R), atol=1e-5)


@pytest.mark.parametrize("degrees", [10, 45, 60, 90, -90, 180])
@pytest.mark.parametrize("columns", [[], R])
def test_heading_off_the_direction_of_travel_is_put_right(tmp_path, degrees, columns):
    log = load(tmp_path, heading(degrees)(good_frame()).drop(columns))
    assert difference(log) < 1e-5
    off = log.pose[:, 2] - good_frame()["yaw"].to_numpy()
    assert abs((np.median(off) + 1) % (2 * np.pi) - 1) < 0.005
    assert not [f for f in log.findings if f.severity != "fixed"]


@pytest.mark.parametrize("degrees", [20, 55, 90, -90, 180])
def test_turned_velocity_sensor_is_turned_back(tmp_path, degrees):
    log = load(tmp_path, with_body(good_frame(), degrees))
    assert difference(log) < 1e-5
    np.testing.assert_allclose(log.body_velocity, good_body(), atol=0.01)
    assert any("turned by" in str(f) for f in log.findings)


@pytest.mark.parametrize("signs", [(1, -1, -1), (1, -1, 1), (1, 1, -1)])
def test_velocity_sensor_upside_down_is_told(tmp_path, signs):
    log = load(tmp_path, with_body(good_frame(), signs=signs))
    assert difference(log) < 1e-5
    np.testing.assert_allclose(log.body_velocity, good_body(), atol=1e-5)
    assert [f.severity for f in log.findings] == ["warning"]


def test_velocities_in_world_axes_are_turned(tmp_path):
    log = load(tmp_path, with_body(good_frame(), world=True))
    assert difference(log) < 1e-5
    assert any("axes of the world" in f.what for f in log.findings)
    assert np.std(log.body_velocity - good_body()) < 0.005


def test_turned_sensor_without_wheel_speeds_asks(tmp_path):
    frame = with_body(good_frame(), 90).drop(V)
    with pytest.raises(ValueError, match="body_velocity: turned by 90 deg; or wheel_torque: "):
        load(tmp_path, frame)


WRONG_WHEELS = {
    "speeds fl fr exchanged": exchange((V[0], V[1])),
    "left wheels exchanged": exchange((V[0], V[2]), (M[0], M[2])),
    "speed fl negated": negate(V[0]),
    "signs of the driver": negate(V[0], V[2], M[0], M[2]),
    "torque fr negated": negate(M[1]),
}


@pytest.mark.parametrize("name", WRONG_WHEELS)
def test_wrong_wheels_are_still_put_right_by_a_reference(tmp_path, name):
    log = load(tmp_path, WRONG_WHEELS[name](good_frame()).drop(P))
    assert difference(log) < 1e-5
    assert log.reference is not None


# Logs beside the project


def test_shared_reference_with_exchanged_axes():
    log = Log.load(shared("broken-inputs", "ref_vx_vy_swapped_nopose.csv"))
    good = Log.load(shared("broken-inputs", "rate100.csv"))
    assert log.reference is None
    np.testing.assert_array_equal(log.wheel_velocity, good.wheel_velocity)


@pytest.mark.parametrize("name", ["c06_rot90.csv", "c07g_yaw_offset90.csv"])
def test_shared_frames_leave_wheels_alone(name):
    log = Log.load(shared("public-cases", name))
    frame = pl.read_csv(shared("public-cases", name), comment_prefix="#", infer_schema_length=None)
    np.testing.assert_array_equal(log.wheel_velocity, frame.select(V))
    assert any("turned by" in str(f) for f in log.findings)
