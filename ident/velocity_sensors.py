"""What the other instruments of a log say about those of its velocities, by kinematics alone."""

from __future__ import annotations

from ident.doctor.odometry import body_against, pose_against_wheels
from ident.instruments import stating
from ident.log import Log
from ident.recording_words import WIDE, Instrument, plain
from youbot_env.effects import get_effect

# Wheel speeds that come later than the pose by this much, s, and by so many standard errors, are
# late: simulated robots with rollers and creep stay below a third of it.
LAG, LATE, CERTAIN = "velocity_filter", 2e-3, 4.0
# Angles, rad, places, m, and biases, rad/s, of a body-velocity sensor that are worth a word.
NOTICED = {"angle": 5e-3, "px": 5e-3, "py": 5e-3, "b": 1e-3}


def witnessed(log: Log) -> tuple[Log, tuple[Instrument, ...]]:
    """The log with what its pose says about the lateness of its wheel speeds stated.

    A pose shows what has happened and is never early: against it speeds can only be too late.
    Where the pose is late itself nothing is said.
    """
    if log.body_velocity is not None:
        return _body_sensor(log)
    shown = log.pose is not None and log.wheel_velocity is not None
    if not shown or LAG in log.recording:
        return log, ()
    seen = pose_against_wheels(log)
    if seen is None or not seen.shift.known or seen.shift.se > LATE:
        return log, ()
    late, half = -seen.shift.value, WIDE * seen.shift.se
    if late < -LATE:
        return log, ()
    if late < max(LATE, CERTAIN * seen.shift.se):
        return stating(log, LAG, T=0.0), ()
    words = (
        f"wheel speeds come {1e3 * late:.3g} ms +- {1e3 * half:.2g} ms later than the pose: a "
        "filter with that time constant, or means over twice that time"
    )
    said = Instrument(LAG, "T", late, "s", (late - half, late + half), "estimated", log.name, words)
    return stating(log, LAG, T=late), (said,)


def _body_sensor(log: Log) -> tuple[Log, tuple[Instrument, ...]]:
    """The log with mounting and bias of its body-velocity sensor, as its wheels or pose show them.

    Kinematics show them whatever forces act; what they leave open diagnosis looks for.
    """
    # Rollers and slip stand between the wheels and the motion, nothing between it and a pose.
    source = "wheels" if log.pose is None else "pose"
    if source == "wheels" and log.wheel_velocity is None:
        return log, ()
    seen = body_against(log, source)
    if seen is None:
        return log, ()
    # Of the wheels against the sensor, and of the sensor against the pose, signs are opposite.
    sign = -1.0 if source == "wheels" else 1.0
    values = {
        ("sensor_mounting", "angle"): (seen.angle, sign),
        ("sensor_mounting", "px"): (seen.lever_x, -sign),
        ("sensor_mounting", "py"): (seen.lever_y, -sign),
        ("gyro_bias", "b"): (seen.bias, -sign),
    }
    told, declared_before = [], set(log.recording)
    for (name, flat), (estimate, turn) in values.items():
        effect = get_effect(name)
        if name in declared_before:
            continue
        least = NOTICED[flat]
        if not estimate.known or abs(estimate.value) < max(least, CERTAIN * estimate.se):
            continue
        stated = log.recording.get(name, {p.name: 0.0 for p in effect.parameters})
        log = stating(log, name, **{**stated, flat: turn * estimate.value})
        told.append(plain(log, effect, flat, turn * estimate.value, estimate.se))
    return log, tuple(told)
