"""Low-pass filter in the measurement of the drive input."""

from youbot_env.effects.base import Effect, Parameter


class DriveFilter(Effect):
    """The rows show the drive input behind a first-order low-pass filter."""

    identifier = "drive_filter"
    title = "Filter of the drive's rows"
    equation = r"T\,\dot M^{\text{log}} + M^{\text{log}} = M"
    link = "sensor"
    parameters = (
        Parameter("T", "s", "time constant", 0.01, (0.0, 0.2), linear=False, scope="record"),
    )
    regime = "changes of torque"
    confusables = ("drive_offset",)
    experiments = ("log the torque before its filter",)
    candidate = False
    order = 10

    def record(self, p, dense):
        """See the class."""
        if p.T > 0:
            dense.filtered("wheel_torque", p.T)

    def restore(self, p, rows):
        """See the class; two filters in a row count with the sum of their time constants."""
        return rows.with_drive(lag=rows.drive.lag + p.T)
