"""Wheels that lose grip on the floor."""

from youbot_env.effects.base import Effect, Parameter
from youbot_env.effects.rolling_resistance import static_loads

# Sharpness of the limit: at half the friction limit 0.05 % of the force is lost, at the limit 8 %.
SHARPNESS = 4
# Smallest viscous friction that holds a spinning wheel, N m s, and smallest load, N.
LEAST_FRICTION, LEAST_LOAD = 0.01, 1.0


class WheelSlip(Effect):
    """Floor force of each wheel limited to f N_i, with a smooth knee (regularised Coulomb).

    Quasi-static: a wheel without slip puts the horizontal force ``F_i`` on the floor, which its net
    shaft torque tau_i and viscous roller friction determine.  Beyond the limit this force keeps its
    direction and loses the share lambda_i.  The torque so set free spins the wheel up until viscous
    friction mu1 takes it, at the slip speed ``lambda_i tau_i / mu1``, and the rollers turn slower
    by the same share.  Left out: the time the wheel needs for that (I1/mu1, 50 ms), its spin
    inertia in tau_i, load transfer, and the slip speed in the friction laws of other effects.
    """

    identifier = "wheel_slip"
    title = "Wheel slip"
    equation = (
        r"F_i \to (1 - \lambda_i) F_i,\quad 1 - \lambda_i = \Bigl(1 +"
        r" \bigl(\tfrac{\lVert F_i\rVert}{f N_i}\bigr)^{8}\Bigr)^{-1/8},\quad"
        r" \sigma_i = \lambda_i\,\tau_i / \mu_1"
    )
    link = "kinematics"
    parameters = (
        Parameter("f", "", "friction coefficient of the floor", 0.3, (0.02, 2.0), linear=False),
    )
    regime = (
        "large floor forces: fast sideways motion, hard starts; wheel speeds contradict each other"
    )
    confusables = ("roller_ripple", "wheel_radius_error", "torque_saturation", "quadratic_drag")
    experiments = ("plateaus at several speeds", "payload")
    background = True
    order = 90  # after everything else on the shaft

    def _torques_and_losses(self, p, s, ops):
        """Net shaft torques and roller torques at the floor, N m, and the shares lost."""
        torques, rollers, losses = [], [], []
        loads = static_loads(s.platform, s.theta, ops)
        for index, load in enumerate(loads):
            rolling, roller = s.geometry.jacobian[index], s.geometry.roller_jacobian[index]
            tau = s.torque[index] - s.theta.mu1 * s.wheel_velocity[index]
            bearing = -s.theta.mu2 * s.roller_velocity[index]
            fx = rolling[0] * tau + roller[0] * bearing
            fy = rolling[1] * tau + roller[1] * bearing
            limit = p.f * ops.maximum(load, LEAST_LOAD)
            demand = (fx * fx + fy * fy) / (limit * limit)
            torques.append(tau)
            rollers.append(bearing)
            losses.append(1.0 - (1.0 + demand**SHARPNESS) ** (-0.5 / SHARPNESS))
        return torques, rollers, losses

    def shaft(self, p, s, ops):
        """Torque that does not reach the floor."""
        torques, _, losses = self._torques_and_losses(p, s, ops)
        return tuple(-loss * tau for loss, tau in zip(losses, torques, strict=True))

    def roller(self, p, s, ops):
        """Friction that slower rollers save."""
        _, rollers, losses = self._torques_and_losses(p, s, ops)
        return tuple(-loss * bearing for loss, bearing in zip(losses, rollers, strict=True))

    def slip(self, p, s, ops):
        """Speed beyond J v at which viscous friction takes the torque set free."""
        torques, _, losses = self._torques_and_losses(p, s, ops)
        friction = ops.maximum(s.theta.mu1, LEAST_FRICTION)
        return tuple(loss * tau / friction for loss, tau in zip(losses, torques, strict=True))
