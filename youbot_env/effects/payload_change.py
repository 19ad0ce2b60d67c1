"""Something put on the robot, or taken off it, during the record."""

from youbot_env.dynamics import Theta
from youbot_env.effects.base import Effect, Parameter

# Half the sample of a 50 Hz log, s: the step takes about one sample and has a derivative in t0.
WIDTH = 0.01


class PayloadChange(Effect):
    """Mass, moment of inertia and centre of mass change at one moment.

    The payload is taken to join at the speed of the robot: the change itself gives no impulse.
    """

    identifier = "payload_change"
    title = "Change of payload"
    equation = (
        r"(m_0, I_0, m a_x, m a_y) \to (m_0 + \Delta m, I_0 + \Delta I, "
        r"m a_x + \Delta p_x, m a_y + \Delta p_y) \text{ at } t_0"
    )
    link = "body"
    parameters = (
        Parameter("dm", "kg", "mass added", 5.0, (-20.0, 60.0), scope="record"),
        Parameter(
            "dI", "kg m^2", "moment of inertia about O added", 0.2, (-3.0, 10.0), scope="record"
        ),
        Parameter("dpx", "kg m", "first moment added, forward", 0.5, (-15.0, 15.0), scope="record"),
        Parameter(
            "dpy", "kg m", "first moment added, to the left", 0.0, (-15.0, 15.0), scope="record"
        ),
        Parameter(
            "t0",
            "s",
            "moment of the change",
            60.0,
            (0.0, 3600.0),
            linear=False,
            profile=tuple(k / 14 for k in range(1, 14)),
            profile_unit="duration",
            smooth=False,
            scope="record",
        ),
    )
    regime = "differs before and after one moment"
    confusables = ("battery_sag", "friction_warmup")
    experiments = ("payload", "repeat later")
    needs_time = True

    def inertial(self, p, s, ops):
        """See the class."""
        on = 0.5 + 0.5 * ops.tanh((s.t - p.t0) / WIDTH)
        return Theta(on * p.dm, on * p.dI, 0.0, on * p.dpx, on * p.dpy, 0.0, 0.0)
