"""Every effect's law at one state, worked out by hand from its documented equation.

Nothing below calls a law: the numbers of the state, the youBot's dimensions and the equations of
docs/effects.md are written out once more, so that a flipped sign, a lost factor, a wrong exponent
or swapped axes cannot stand on both sides.
"""

from math import atan, cos, exp, floor, hypot, pi, sin, sqrt, tan, tanh

import numpy as np
import pytest
from scipy.integrate import quad

from youbot_env.backend import FLOAT
from youbot_env.dynamics import Theta
from youbot_env.effects import Signals, effect_names, get_effect
from youbot_env.measurement import Dense, DriveInput, Rows
from youbot_env.platform import youbot

# The robot: half track, half base, wheel and roller radius, m; then theta, m a_x and m a_y as such.
TRACK, BASE, R, SMALL = 0.15, 0.2355, 0.0475, 0.014
M0, I0, I1, MAX, MAY, MU1, MU2 = 35.3, 4.4, 6e-3, 1.2, -0.8, 0.11, 5.78e-3
G = 9.81
# The state: time, body velocity, pose, wheel angles and torques; wheels in the order fl fr rl rr.
T = 30.0
VX, VY, OM = 0.35, -0.1, 0.9
X, Y, YAW = 1.2, -0.7, 0.6
ANGLE = (0.3, -1.1, 2.0, 0.7)
TORQUE = (2.0, -1.5, 1.0, 0.5)
# Places of the wheels and tangents of their roller angles.
PLACES = ((BASE, TRACK), (BASE, -TRACK), (-BASE, TRACK), (-BASE, -TRACK))
SLANTS = (-1, 1, 1, -1)

# Equation (3) of the paper for this robot.
J = [(1 / R, k / R, (k * x - y) / R) for (x, y), k in zip(PLACES, SLANTS, strict=True)]
ROLLERS = [(0.0, -sqrt(2) / SMALL, -sqrt(2) * x / SMALL) for x, _ in PLACES]
WHEEL = [(VX + k * VY + (k * x - y) * OM) / R for (x, y), k in zip(PLACES, SLANTS, strict=True)]
ROLLER = [-sqrt(2) * (VY + x * OM) / SMALL for x, _ in PLACES]
SIGN = (1, 1, -1, 1)  # of the wheel speeds
LOADS = [G * (M0 / 4 + MAX * x / (4 * BASE**2) + MAY * y / (4 * TRACK**2)) for x, y in PLACES]
C, S = cos(YAW), sin(YAW)


def test_the_state_is_where_signs_are_sharp():
    """Laws round their signs off over 0.1 rad/s of a wheel and 0.3 rad/s of a roller."""
    assert [np.sign(w) for w in WHEEL] == list(SIGN)
    assert [np.sign(g) for g in ROLLER] == [-1, -1, 1, 1]
    assert min(map(abs, WHEEL)) > 2.0
    assert min(map(abs, ROLLER)) > 10.0
    assert min(LOADS) > 0.0


def to_body(fx, fy):
    """A force of the world in the axes of the body, R(psi)' F."""
    return C * fx + S * fy, C * fy - S * fx


def against(size, vx, vy):
    """A force of one size against a velocity."""
    return -size * vx / hypot(vx, vy), -size * vy / hypot(vx, vy)


def weighed(sx, sy):
    """Wrench of a slope: the weight acts on the centre of mass."""
    gx, gy = G * np.array(to_body(sx, sy))
    return M0 * gx, M0 * gy, MAX * gy - MAY * gx


def carpet(cx, cy, cxy, nx, ny):
    wx, wy = C * VX - S * VY, S * VX + C * VY
    eased = (nx * wx + ny * wy) / hypot(wx, wy)
    return *to_body(eased * wx - cx * wx - cxy * wy, eased * wy - cxy * wx - cy * wy), 0.0


def caster(fc, px, py):
    fx, fy = against(fc, VX - OM * py, VY + OM * px)
    return fx, fy, px * fy - py * fx


def patch(dmu, alpha, edge):
    """Front wheels stand at x of 1.31 m and 1.48 m, rear wheels at 0.92 m and 1.09 m."""
    places = [(X + C * x - S * y, Y + S * x + C * y) for x, y in PLACES]
    beyond = [x * cos(alpha) + y * sin(alpha) - edge for x, y in places]
    return [-dmu * w * (0.5 + 0.5 * tanh(b / 0.03)) for w, b in zip(WHEEL, beyond, strict=True)]


def tilted(e):
    """Roller angles delta + e instead of 45 degrees."""
    deltas = [atan(k) + d for k, d in zip(SLANTS, e, strict=True)]
    both = zip(PLACES, deltas, strict=True)
    wheels = [(1 / R, tan(d) / R, (tan(d) * x - y) / R) for (x, y), d in both]
    return wheels, [
        (0.0, -1 / (SMALL * cos(d)), -x / (SMALL * cos(d)))
        for (x, _), d in zip(PLACES, deltas, strict=True)
    ]


def rippled(starts):
    """Finite rollers; how fast they turn is scaled to lose as much power as ideal ones do."""

    def arm(q):
        return R * cos(q) - (R - SMALL)

    lasts = quad(cos, -pi / 6, pi / 6)[0]
    power = quad(lambda q: cos(q) * (SMALL / arm(q)) ** 2, -pi / 6, pi / 6)[0] / lasts
    wheels, rollers = [], []
    for (x, y), k, angle, start in zip(PLACES, SLANTS, ANGLE, starts, strict=True):
        q = (angle + start + pi / 6) % (pi / 3) - pi / 6
        across = k / cos(q)
        wheels.append((1 / R, across / R, (across * x - y - (R - SMALL) * tan(q) * k) / R))
        rate = sqrt(2) / arm(q) / sqrt(power)
        rollers.append((0.0, -rate, -rate * x))
    return wheels, rollers


def slipping(f):
    """Net torques at the shafts, torques in the rollers and the shares lost."""
    net = [m - MU1 * w for m, w in zip(TORQUE, WHEEL, strict=True)]
    bearing = [-MU2 * g for g in ROLLER]
    shares = []
    for tau, q, k, load in zip(net, bearing, SLANTS, LOADS, strict=True):
        force = hypot(tau / R, k * tau / R - sqrt(2) * q / SMALL)
        shares.append(1 - (1 + (force / (f * load)) ** 8) ** (-1 / 8))
    return net, bearing, shares


NET, BEARING, LOST = slipping(0.3)
EACH = (0.1, 0.2, 0.3, 0.4)
RADII = (0.1, -0.05, 0.2, 0.15)


def each(name, values=EACH):
    return dict(zip([f"{name}_{wheel}" for wheel in ("fl", "fr", "rl", "rr")], values, strict=True))


GONE = 0.25 * (1 - exp(-30 / 60))  # of friction or torque after half a minute
STRIBECK = [
    -s * (fc + (0.6 - fc) * exp(-((w / 3.0) ** 2)))
    for s, fc, w in zip(SIGN, EACH, WHEEL, strict=True)
]
RIPPLE = [a * cos(5 * q) + 0.7 * sin(5 * q) for a, q in zip(EACH, ANGLE, strict=True)]
LIMITED = (1.2, -1.2, 1.0, 0.5)

# A carpet keeps its direction smooth at rest; rates of finite rollers hold a mean over a grid.
ROUNDED = {"carpet": 1e-5, "roller_ripple": 3e-4}

# (effect, its parameters, hook, what the hook must return)
ROWS = [
    ("battery_sag", {"a": 0.25, "T": 60}, "drive", [(1 - GONE) * m for m in TORQUE]),
    ("torque_gain", each("e"), "drive", (2.2, -1.8, 1.3, 0.7)),
    ("torque_offset", each("b"), "drive", (1.9, -1.7, 0.7, 0.1)),
    ("torque_dead_zone", 0.6, "drive", (1.4, -0.9, 0.4, 0.0)),
    ("torque_saturation", 1.2, "drive", LIMITED),
    ("actuator_delay", 0.034, "delay", 0.034),
    ("wheel_coulomb_friction", each("fc"), "shaft", (-0.1, -0.2, 0.3, -0.4)),
    ("stribeck_friction", {**each("fc"), "fs": 0.6, "ws": 3.0}, "shaft", STRIBECK),
    ("direction_dependent_friction", {"forward": 0.2, "backward": 0.3}, "shaft",
     (-0.2, -0.2, 0.3, -0.2)),
    ("load_dependent_friction", 0.2, "shaft", (-0.4, -0.3, 0.2, -0.1)),
    ("wheel_friction_asymmetry", each("dmu"), "shaft",
     [-d * w for d, w in zip(EACH, WHEEL, strict=True)]),
    ("rolling_resistance", 0.02, "shaft",
     [-0.02 * R * n * s for n, s in zip(LOADS, SIGN, strict=True)]),
    ("torque_ripple", {**each("a"), "b": 0.7, "k": 5}, "shaft", RIPPLE),
    ("torque_ripple", {"a": 0.0, "b": 0.7, "k": 5}, "shaft", [0.7 * sin(5 * q) for q in ANGLE]),
    ("torque_ripple_second", {**each("a"), "b": 0.7, "k": 5}, "shaft", RIPPLE),
    ("friction_warmup", {"a": 0.25, "T": 60}, "shaft", [GONE * MU1 * w for w in WHEEL]),
    ("friction_warmup", {"a": 0.25, "T": 60}, "roller", [GONE * MU2 * g for g in ROLLER]),
    ("floor_patch", {"dmu": 0.3, "angle": 0.4, "dist": 0.8}, "shaft", patch(0.3, 0.4, 0.8)),
    ("roller_coulomb_friction", 0.02, "roller", (0.02, 0.02, -0.02, -0.02)),
    ("floor_slope", {"sx": 0.03, "sy": -0.05}, "body", weighed(0.03, -0.05)),
    ("ramp", {"s": 0.04, "angle": 0.7, "dist": 0.4}, "body",
     np.array(weighed(-0.04 * cos(0.7), -0.04 * sin(0.7)))
     * (0.5 + 0.5 * tanh((X * cos(0.7) + Y * sin(0.7) - 0.4) / BASE))),
    ("cable_tether", {"k": 4, "fx": 2, "fy": -6}, "body", (*to_body(2 - 4 * X, -6 - 4 * Y), 0)),
    ("quadratic_drag", 60, "body", (-60 * hypot(VX, VY) * VX, -60 * hypot(VX, VY) * VY, 0)),
    ("body_dry_friction", 12, "body", (*against(12, VX, VY), 0)),
    ("carpet", {"cx": 70, "cy": 40, "cxy": 15, "nx": 20, "ny": -8}, "body",
     carpet(70, 40, 15, 20, -8)),
    ("caster_drag", {"fc": 14, "px": -0.3, "py": 0.2}, "body", caster(14, -0.3, 0.2)),
    ("yaw_scrub_friction", 2.5, "body", (0, 0, -2.5)),
    ("payload_change", {"dm": 4, "dI": 0.3, "dpx": 0.4, "dpy": -0.2, "t0": 29}, "inertial",
     (4, 0.3, 0, 0.4, -0.2, 0, 0)),
    ("payload_change", {"dm": 4, "dI": 0.3, "dpx": 0.4, "dpy": -0.2, "t0": 31}, "inertial",
     (0,) * 7),
    ("payload_change", {"dm": 4, "dI": 0.3, "dpx": 0.4, "dpy": -0.2, "t0": 29.99}, "inertial",
     (0.5 + 0.5 * tanh(1)) * np.array((4, 0.3, 0, 0.4, -0.2, 0, 0))),
    ("wheel_radius_error", each("e", RADII), "kinematics",
     ([np.array(row) / (1 + e) for row, e in zip(J, RADII, strict=True)], ROLLERS)),
    ("base_geometry_error", 0.05, "kinematics",
     ([(a, b, 1.05 * c) for a, b, c in J], [(a, b, 1.05 * c) for a, b, c in ROLLERS])),
    ("roller_angle_error", each("e", (0.03, -0.02, 0.01, 0.05)), "kinematics",
     tilted((0.03, -0.02, 0.01, 0.05))),
    ("roller_ripple", {"size": 1, **each("phi0", (0.1, -0.2, 0.3, 0.4))}, "kinematics",
     rippled((0.1, -0.2, 0.3, 0.4))),
    ("wheel_slip", 0.3, "shaft", [-k * tau for k, tau in zip(LOST, NET, strict=True)]),
    ("wheel_slip", 0.3, "roller", [-k * q for k, q in zip(LOST, BEARING, strict=True)]),
    ("wheel_slip", 0.3, "slip", [k * tau / MU1 for k, tau in zip(LOST, NET, strict=True)]),
]  # fmt: skip


def parameters(name, values):
    effect = get_effect(name)
    return effect, effect.arrange(effect.complete(values, youbot()), youbot())


def signals(v=(VX, VY, OM)):
    theta = Theta(M0, I0, I1, MAX, MAY, MU1, MU2)
    return Signals(youbot(), youbot().geometry, theta, T, v, (X, Y, YAW), ANGLE, TORQUE)


@pytest.mark.parametrize(("name", "values", "hook", "wanted"), ROWS, ids=lambda x: str(x)[:24])
def test_the_law_at_one_state(name, values, hook, wanted):
    (effect, p), s = parameters(name, values), signals()
    if hook == "drive":
        got = effect.drive(p, TORQUE, s, FLOAT)
    elif hook == "delay":
        got = effect.delay(p)
    elif hook == "kinematics":
        got = effect.kinematics(p, s.geometry, s, FLOAT)[:2]
    else:
        got = getattr(effect, hook)(p, s, FLOAT)
    np.testing.assert_allclose(got, wanted, rtol=ROUNDED.get(name, 1e-9), atol=1e-9)


def test_half_the_ripple_is_half_the_deviation():
    both = [parameters("roller_ripple", {"size": size, "phi0": 0.2}) for size in (0.0, 0.5, 1.0)]
    none, half, full = (
        np.array(effect.kinematics(p, signals().geometry, signals(), FLOAT).jacobian)
        for effect, p in both
    )
    np.testing.assert_allclose(none, J, rtol=1e-12)
    np.testing.assert_allclose(half, 0.5 * (none + full), rtol=1e-12)
    assert np.abs(full - none).max() > 0.1


def test_loads_and_slip_speeds_of_the_row_are_worth_a_row():
    assert max(LOST) > 0.1
    assert sum(LOADS) == pytest.approx(G * M0)


def test_a_wheel_that_would_be_pulled_down_carries_nothing():
    """The centre of mass far in front: all rolling resistance is that of the front wheels."""
    effect, p = parameters("rolling_resistance", 0.02)
    s = signals()
    s.theta = s.theta._replace(max=M0 * 2 * BASE, may=0.0)
    front, rear = G * M0 * 0.02 * R * 0.75, 0.0
    torques = effect.shaft(p, s, FLOAT)
    np.testing.assert_allclose(torques, (-front, -front, rear, rear), atol=1e-9)


# One wheel speed or roller rate is enough to see over which width a sign is rounded off.
SLOW = [
    ("wheel_coulomb_friction", 0.2, "shaft", (0.1 * R, 0, 0), -0.2 * tanh(1), 0),
    ("stribeck_friction", {"fc": 0.2, "fs": 0.2}, "shaft", (0.1 * R, 0, 0), -0.2 * tanh(1), 0),
    ("direction_dependent_friction", {"forward": 0.2, "backward": 0.5}, "shaft", (0.1 * R, 0, 0),
     -0.2 * tanh(1), 0),
    ("load_dependent_friction", 0.2, "shaft", (0.1 * R, 0, 0), -0.4 * tanh(1), 0),
    ("rolling_resistance", 0.02, "shaft", (0.1 * R, 0, 0), -0.02 * R * LOADS[0] * tanh(1), 0),
    ("roller_coulomb_friction", 0.02, "roller", (0, 0.3 * SMALL / sqrt(2), 0), 0.02 * tanh(1), 0),
    ("body_dry_friction", 12, "body", (0, -0.1 * R, 0), 12 * tanh(1), 1),
    ("caster_drag", {"fc": 12, "px": -0.3, "py": 0}, "body", (0, -0.1 * R, 0), 12 * tanh(1), 1),
    ("yaw_scrub_friction", 2.5, "body", (0, 0, 0.1 * R / (TRACK + BASE)), -2.5 * tanh(1), 2),
]  # fmt: skip


@pytest.mark.parametrize(("name", "values", "hook", "v", "wanted", "at"), SLOW)
def test_signs_are_rounded_off_over_a_tenth_of_a_radian_per_second(
    name, values, hook, v, wanted, at
):
    effect, p = parameters(name, values)
    assert getattr(effect, hook)(p, signals(v), FLOAT)[at] == pytest.approx(wanted, rel=1e-6)


def test_lag_and_bristles_follow_their_differential_equations():
    """Held inputs: exponentials towards the command and towards the sign of the speed."""
    s, start = signals(), (0.5, -0.5, 0.0, 1.0)
    lag, p = parameters("actuator_lag", 0.03)
    s.state, keep = start, exp(-0.012 / 0.03)
    wanted = [m + keep * (z - m) for m, z in zip(TORQUE, start, strict=True)]
    np.testing.assert_allclose(lag.evolve(p, TORQUE, s, 0.012, FLOAT), wanted, rtol=1e-12)
    assert tuple(lag.drive(p, TORQUE, s, FLOAT)) == start
    assert lag.time_constant(p) == 0.03
    bristles, p = parameters("presliding_friction", {"fc": 0.4, "bend": 0.05})
    wanted = [
        sign + (y - sign) * exp(-abs(w) * 0.012 / 0.05)
        for sign, y, w in zip(SIGN, start, WHEEL, strict=True)
    ]
    np.testing.assert_allclose(bristles.evolve(p, TORQUE, s, 0.012, FLOAT), wanted, rtol=1e-8)
    np.testing.assert_allclose(bristles.shaft(p, s, FLOAT), (-0.2, 0.2, 0.0, -0.4), atol=1e-12)


# What instruments make of a body velocity of (0.35, -0.1, 0.9) and wheel speeds of TORQUE rad/s.
TURNED = (VX - OM * 0.2, VY + OM * 0.1)
READINGS = [
    ("gyro_bias", 0.05, "body_velocity", (0.35, -0.1, 0.95)),
    ("gyro_scale", 0.1, "body_velocity", (0.35, -0.1, 0.99)),
    ("sensor_mounting", {"angle": 0.3, "px": 0.1, "py": 0.2}, "body_velocity",
     (cos(0.3) * TURNED[0] + sin(0.3) * TURNED[1], cos(0.3) * TURNED[1] - sin(0.3) * TURNED[0],
      0.9)),
    ("speed_quantisation", 0.3, "wheel_velocity",
     [0.3 * floor(w / 0.3 + 0.5) for w in (2.0, -1.6, 1.0, 0.5)]),
]  # fmt: skip


@pytest.mark.parametrize(("name", "values", "channel", "wanted"), READINGS)
def test_what_an_instrument_shows(name, values, channel, wanted):
    effect, p = parameters(name, values)
    time = np.array([0.0, 0.1])
    happened = {"body_velocity": (0.35, -0.1, 0.9), "wheel_velocity": (2.0, -1.6, 1.0, 0.5)}
    channels = {key: np.tile(row, (2, 1)) for key, row in happened.items()}
    dense = Dense(youbot(), {"time": time, **channels})
    effect.record(p, dense)
    np.testing.assert_allclose(dense.channels[channel], [wanted] * 2, rtol=1e-12)
    other = next(key for key in happened if key != channel)
    np.testing.assert_array_equal(dense.channels[other], channels[other])
    if name != "speed_quantisation":  # what was rounded away is gone
        shown = DriveInput(time, np.zeros((2, 4)))
        rows = Rows(youbot(), time, shown, None, dense.channels["body_velocity"])
        back = effect.restore(p, rows).body_velocity
        np.testing.assert_allclose(back, channels["body_velocity"], atol=1e-12)


def test_filters_answer_a_step_by_their_exponential_and_clocks_shift_it():
    time = np.arange(0, 0.2, 1e-3)
    step = np.where(time >= 0.05, 1.0, 0.0)[:, None] * np.arange(1.0, 5.0)

    def recorded(name, values):
        effect, p = parameters(name, values)
        channels = {"wheel_torque": step, "wheel_velocity": step, "body_velocity": step[:, :3]}
        dense = Dense(youbot(), {"time": time, **channels})
        effect.record(p, dense)
        return dense

    late = recorded("drive_offset", 0.03).channels
    np.testing.assert_allclose(late["wheel_torque"][30:], step[:-30], atol=1e-9)
    assert late["wheel_velocity"] is step
    since = np.maximum(time - 0.049, 0.0)[:, None]  # a held input answers by the end of its step
    for name, changed, left in (
        ("drive_filter", ("wheel_torque",), ("wheel_velocity", "body_velocity")),
        ("velocity_filter", ("wheel_velocity", "body_velocity"), ("wheel_torque",)),
    ):
        shown = recorded(name, 0.02).channels
        answer = (1 - np.exp(-since / 0.02)) * np.arange(1.0, 5.0)
        for channel in changed:
            wanted = answer[:, : shown[channel].shape[1]]
            np.testing.assert_allclose(shown[channel], wanted, atol=1e-9)
        for channel in left:
            assert shown[channel].max() == step[:, : shown[channel].shape[1]].max()
            assert set(np.unique(shown[channel])) <= {0.0, 1.0, 2.0, 3.0, 4.0}
    for kind in ("held", "sampled", "averaged"):
        assert recorded("drive_hold", kind).hold == kind


def test_what_is_restored_undoes_what_was_recorded():
    """A drive that is late by d and filtered by T is read at t + d, plus T times its slope."""
    time = np.arange(0, 1.0, 0.01)
    rows = Rows(youbot(), time, DriveInput(time, np.tile(time[:, None], (1, 4)), "held"), None)
    for name, values in (("drive_offset", 0.05), ("drive_filter", 0.03), ("drive_hold", "sampled")):
        effect, p = parameters(name, values)
        rows = effect.restore(p, rows)
    # Of a straight line through the origin: its mean over a row is that in the middle of it.
    wanted = time + 0.005 + 0.05 + 0.03
    np.testing.assert_allclose(rows.drive.means()[10:-10, 2], wanted[10:-10], atol=1e-9)
    effect, p = parameters("velocity_filter", 0.04)
    speed = np.tile(3 * time[:, None], (1, 4))
    shown = effect.restore(p, Rows(youbot(), time, rows.drive, speed, speed[:, :3]))
    np.testing.assert_allclose(shown.wheel_velocity, speed + 0.12, atol=1e-9)
    np.testing.assert_allclose(shown.body_velocity, speed[:, :3] + 0.12, atol=1e-9)


def test_no_effect_is_without_its_row():
    single = {"actuator_lag", "presliding_friction", "velocity_filter"}
    single |= {"drive_offset", "drive_filter", "drive_hold"}
    done = {name for name, *_ in ROWS + READINGS} | single
    assert set(effect_names()) <= done


def test_on_real_rollers_a_delay_between_two_steps_is_shared_out_between_them():
    """2.3 ms late in steps of 1 ms: 0.7 of the command 2 steps ago, 0.3 of the one before."""
    pytest.importorskip("mujoco")
    from youbot_env.model_file import load_model
    from youbot_env.rollers import RollersPlant

    model = load_model("paper").with_effects({"actuator_delay": 0.0023})
    plant, arrived = RollersPlant(model, dt=0.001, timestep=0.001), []
    plant.reset()
    for k in range(1, 6):
        plant.step(np.full(4, 0.1 * k))
        arrived.append(plant.delivered_torque[0])
    np.testing.assert_allclose(arrived, (0.0, 0.0, 0.07, 0.17, 0.27), atol=1e-12)
