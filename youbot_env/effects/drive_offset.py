"""Clock of the drive input against that of the velocities."""

from youbot_env.effects.base import Effect, Parameter


class DriveOffset(Effect):
    """Rows of the drive input show what it was some time ago, or will be.

    No robot answers before it is driven, so late rows are always the recording's.  Early ones look
    like a delay of the drive or like late velocities.
    """

    identifier = "drive_offset"
    title = "Offset of the drive's clock"
    equation = r"M^{\text{log}}(t) = M(t - d)"
    link = "sensor"
    parameters = (
        Parameter("d", "s", "time by which the rows are late", 0.01, (-0.3, 0.3), linear=False,
                  scope="record"),
    )  # fmt: skip
    regime = "changes of torque"
    confusables = ("actuator_delay", "actuator_lag", "drive_filter", "velocity_filter")
    experiments = ("one clock for all channels", "a pose or a gyro beside the wheels")
    candidate = False
    order = 20

    def record(self, p, dense):
        """See the class."""
        dense.late("wheel_torque", p.d)

    def restore(self, p, rows):
        """See the class."""
        return rows.with_drive(offset=rows.drive.offset + p.d)
