"""Low-pass filter in the measurement of the velocities."""

from youbot_env.effects.base import Effect, Parameter
from youbot_env.measurement import slope

# Motion is straight over this time, s: 5 Hz at most leave a robot of this size.
STRAIGHT = 0.05


class VelocityFilter(Effect):
    """Measured velocities, of wheels and body, lag behind: a first-order low-pass filter.

    A mean over some time, as drives make it of encoder counts, lags by half that time.
    """

    identifier = "velocity_filter"
    title = "Filter of the velocities"
    equation = r"T\,\dot v^{\text{log}} + v^{\text{log}} = v"
    link = "sensor"
    parameters = (
        Parameter("T", "s", "time constant", 0.01, (0.0, 0.2), linear=False, scope="record"),
    )
    regime = "changes of speed"
    confusables = ("actuator_delay", "actuator_lag", "drive_offset")
    experiments = ("a pose beside the wheels", "log speeds before their filter")
    late = True
    order = 10

    def record(self, p, dense):
        """See the class."""
        for name in ("wheel_velocity", "body_velocity"):
            if p.T > 0 and name in dense.channels:
                dense.filtered(name, p.T)

    def restore(self, p, rows):
        """See the class."""
        channels = {}
        for name in ("wheel_velocity", "body_velocity"):
            shown = getattr(rows, name)
            if shown is not None and len(rows.time) > 2:
                channels[name] = shown + p.T * slope(rows.time, shown, STRAIGHT)
        return rows.changed(**channels)
