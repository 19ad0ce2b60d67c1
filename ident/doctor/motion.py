"""Is there a motion to learn from: velocities, length, excitation."""

from __future__ import annotations

import numpy as np

from ident.doctor.record import Record

SHORTEST, SHORT = 2.0, 10.0  # s: refused below the first, told below the second
FEWEST = 20  # samples: of fewer nothing can be said, whoever accepts them
# Whether logs hold enough together is asked over all of them.
MORE = "give it together with others of this robot, or record longer"
REST = 0.01  # m/s at the wheel: slower is rest
AXES = ("forward", "sideways", "yaw")


def check_velocity(record: Record) -> None:
    """Refuse a log without velocities."""
    if not {"wheel_velocity", "wheel_position", "body_velocity"} & set(record.channels):
        first = record.platform.wheel_names[0]
        names = ", ".join(record.header[:40]) + (", ..." if len(record.header) > 40 else "")
        record.refuse(
            "velocities",
            f"there are no velocities of wheels or body; the columns are {names}",
            "header",
            f"add wheel_velocity_{first} ... or body_velocity_x, body_velocity_y, yaw_rate (rename "
            f"with --map wheel_velocity_{first}=COLUMN and so on); a record of one motor on a "
            "bench says nothing about the platform",
            final=True,
        )


def check_length(record: Record) -> None:
    """Refuse a log that is too short; tell a short one."""
    duration = float(record.time[-1] - record.time[0])
    if duration < SHORTEST:
        what, few = f"the log lasts {duration:.3g} s", len(record.time) < FEWEST
        record.refuse("short", what, "file", f"record {SHORT:.0f} s or more", final=few)
    elif duration < SHORT:
        record.warn("short", f"the log lasts only {duration:.3g} s", "file", MORE)


def check_motion(record: Record) -> None:
    """Refuse a log that rests; tell axes that hardly move."""
    velocity = body_velocity(record) * [1, 1, record.platform.lever]
    rms = np.sqrt(np.mean(velocity**2, axis=0))
    if rms.max() < REST:
        record.refuse(
            "rest",
            f"the robot hardly moves: {rms.max() * 1e3:.2g} mm/s rms",
            "whole log",
            "record a motion on all axes",
        )
        return
    for axis in np.flatnonzero(rms < REST):
        record.warn(
            "rest",
            f"hardly any {AXES[axis]} motion: {rms[axis] * 1e3:.2g} mm/s rms at the wheels",
            "whole log",
            "what acts on that axis alone cannot be found",
        )


def body_velocity(record: Record) -> np.ndarray:
    """(N, 3) body velocities: the independent measurement, else from the wheels."""
    if "body_velocity" in record.channels:
        return record.channels["body_velocity"]
    return record.channels["wheel_velocity"] @ np.linalg.pinv(record.platform.jacobian_array).T
