"""What one robot sees and earns, compiled: the task and its reference as one CasADi function.

Traced from ``TrackingTask`` and ``Reference.evaluate``; the vector environment calls the same two
on arrays.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from youbot_env.backend import casadi_ops
from youbot_env.compiled import InPlace
from youbot_env.envs.task import TrackingTask
from youbot_env.references import Reference


@lru_cache(maxsize=64)
def observation_function(task: TrackingTask, reference: Reference) -> ca.Function:
    """Build (or find) the function of one observation.

    Returns:
        ``F(motion, action, values, t, noise) -> (observation, reward, lost, wanted, twist)`` with
        ``motion`` (x, y, yaw, V_X, V_Y, Omega), ``values`` those of the reference, ``noise`` added
        to the first six observations, ``wanted`` the reference pose, ``twist`` its body velocities.
    """
    ops = casadi_ops()
    motion, noise = ca.SX.sym("motion", 6), ca.SX.sym("noise", 6)
    action = ca.SX.sym("action", task.action_space.shape[0])
    values, t = ca.SX.sym("values", reference.size), ca.SX.sym("t")
    drawn = ca.vertsplit(values)
    wanted = reference.evaluate(drawn, t, ops)
    twists = [reference.evaluate(drawn, t + ahead, ops).twist(ops) for ahead in task.preview_times]
    pose, velocity = tuple(ca.vertsplit(motion[:3])), tuple(ca.vertsplit(motion[3:]))
    heading = ops.cos_sin(pose[2])
    error = task.error(pose, heading, wanted.pose, ops)
    added = ca.vertsplit(noise)
    flat = task.observe(
        tuple(e + n for e, n in zip(error, added[:3], strict=True)),
        tuple(v + n for v, n in zip(velocity, added[3:], strict=True)),
        heading,
        twists,
    )
    reward, lost = task.judge(error, tuple(ca.vertsplit(action)), ops)
    bound = ca.DM(task.observation_space.high.astype(float))
    observation = ca.fmin(ca.fmax(ca.vertcat(*flat), -bound), bound)
    wanted_pose, twist = ca.vertcat(*wanted.pose), ca.vertcat(*twists[0])
    outputs = [ca.cse(observation), reward, lost, wanted_pose, twist]
    return ca.Function("observation", [motion, action, values, t, noise], outputs)


class Observation(InPlace):
    """Calls an observation function in place.

    Attributes:
        action, values, noise: inputs, written by the caller.
        wanted, twist: reference pose and body velocities of the last observation.
    """

    def __init__(self, task: TrackingTask, reference: Reference):
        function = observation_function(task, reference)
        self.action = np.zeros(task.action_space.shape)
        self.values, self.noise = np.zeros(reference.size), np.zeros(6)
        self.wanted, self.twist = np.zeros(3), np.zeros(3)
        self._motion, self._time = np.zeros(6), np.zeros(1)
        self._observation = np.zeros(task.observation_space.shape)
        self._reward, self._lost = np.zeros(1), np.zeros(1)
        inputs = (self._motion, self.action, self.values, self._time, self.noise)
        outputs = (self._observation, self._reward, self._lost, self.wanted, self.twist)
        self._connect(function, inputs, outputs)

    def __call__(self, motion, t: float) -> tuple[np.ndarray, float, bool]:
        """Return ``(observation float32, reward, lost)`` at motion (6,) and time t, s."""
        self._motion[:] = motion
        self._time[0] = t
        self._call()
        observation = self._observation.astype(np.float32)
        return observation, self._reward.item(), self._lost.item() > 0.5
