"""The single environments: one robot, analytic or with real rollers, follows a reference."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np

from youbot_env.backend import FLOAT, NUMPY
from youbot_env.envs.noise import BLOCK, KEYS, noise_block, noise_keys
from youbot_env.envs.observation import Observation
from youbot_env.envs.options import EpisodeOptions, check_action, diverged
from youbot_env.envs.settings import TrackingSettings
from youbot_env.model import Model
from youbot_env.simulation import AnalyticPlant

# How much of the reference path is drawn, s.
DRAWN_SECONDS = 60.0


class TrackingEnv(gym.Env):
    """The base of a KUKA youBot follows a moving reference pose.

    ## Action space
    ``Box(-1, 1, (n,), float32)``; values outside are clipped.

    | level | n | action 1 means |
    |---|---|---|
    | ``torque`` | number of wheels | ``torque_limit`` (4 N m) on the shaft of that wheel |
    | ``velocity`` | 3 | ``speed_limit`` (0.8 m/s) forward and to the left, ``yaw_rate_limit`` |

    (1.6 rad/s).  On level ``velocity`` the wheel-speed loops on board follow the action.

    ## Observation space
    ``Box`` of 8 + 3 (preview + 1) float32, finite bounds.

    | entries | what | unit |
    |---|---|---|
    | 0-2 | reference pose seen from the robot: ahead, left, yaw in [-pi, pi) | m, m, rad |
    | 3-5 | body velocity V_X, V_Y, Omega | m/s, m/s, rad/s |
    | 6-7 | cosine and sine of the yaw | |
    | 8-10 | twist of the reference now, in its own body frame | m/s, m/s, rad/s |
    | 11- | the same at ``preview`` later instants, ``preview_stride`` periods apart | |

    With ``sensors`` the first six entries carry their noise.

    ## Reward
    ``(1 - 0.1 mean(action^2)) / (1 + (distance / 0.1 m)^2 + (yaw error / 0.2 rad)^2)``, in [0, 1].

    ## Starting state
    At rest, the reference pose displaced by uniform +-0.05 m and +-0.1 rad.
    ``reset(options=...)`` takes ``offset`` (ahead, left, yaw; m, m, rad), ``velocity`` (V_X, V_Y,
    Omega), ``follow`` (True: start with the reference's velocity) and ``reference``.

    ## Episode end
    Terminated when farther than 1 m or 90 degrees from the reference.  Truncated after
    ``max_episode_steps`` (1000 registered), or at the end of a reference that has one.

    ## Arguments
    See ``TrackingSettings``.  ``info`` holds ``time`` (s), ``pose``, ``reference_pose`` (m, m,
    rad) and ``torque`` (N m); after a reset with ``reveal_parameters`` also ``true_parameters``.

    ## Version history
    * v0: first version
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array", "human"], "render_fps": 50}

    def __init__(self, render_mode: str | None = None, **settings: Any):
        """Make the environment.

        Args:
            render_mode: ``rgb_array``, ``human`` or None.
            **settings: fields of ``TrackingSettings``.

        Raises:
            TypeError: an unknown argument, or one of a wrong type.
            ValueError: an argument that cannot be used; the message names value and remedy.
        """
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(
                f"render_mode = {render_mode!r}; choose one of {self.metadata['render_modes']}"
            )
        chosen = TrackingSettings(**settings)
        self.model, self.task, self.reference = chosen.robot, chosen.task, chosen.followed
        self.randomization, self.reveal_parameters = chosen.randomization, chosen.reveal_parameters
        self.sensors, self.wheel_loop, self._noise_scale = chosen.sensors, chosen.loop, chosen.noise
        self.render_mode = render_mode
        self.action_space = self.task.action_space
        self.observation_space = self.task.observation_space
        self._size = self.action_space.shape
        self._plant = self._make_plant(self.model)
        self._observation: Observation | None = None
        self._view = None

    def _make_plant(self, model: Model):
        return AnalyticPlant(model, self.task.dt)

    def _replace_robot(self, model: Model) -> None:
        self._plant.set_model(model)

    def _motion(self) -> np.ndarray:
        return self._plant.motion()

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Start an episode; see the class for ``options``."""
        super().reset(seed=seed)
        chosen = EpisodeOptions.parse(options)
        rng = self.np_random
        if self.randomization is not None:
            self._replace_robot(self.randomization.draw(self.model, rng))
        reference = chosen.reference or self.reference
        if self._observation is None or reference is not self._followed:
            self._observation, self._followed = Observation(self.task, reference), reference
        constant = reference.constant
        self._observation.values[:] = reference.draw(rng) if constant is None else constant
        first = reference.evaluate(self._observation.values.tolist(), 0.0, FLOAT)
        offset = chosen.offset_from(rng.random(3).tolist())
        pose, velocity = chosen.start(first, offset, FLOAT)
        self._plant.reset(pose, velocity)
        self._steps, self._end, self._trail, self._path = 0, reference.duration, [], None
        self._keys = noise_keys(rng.random(KEYS).tolist(), FLOAT) if self.sensors else None
        self._noise = self._next_noise(0)
        self._integral = self._torque = (0.0,) * len(self.task.platform.wheels)
        observation, _, _ = self._see(0.0)
        info = self._info()
        if self.reveal_parameters:
            model = self._plant.model
            info["true_parameters"] = dict(zip(model.names(), model.values(), strict=True))
        if self.render_mode == "human":
            self.render()
        return observation, info

    def step(self, action):
        """Apply one action for ``dt``.

        Raises:
            ValueError: an action of another shape or type, or one that is not finite.
            FloatingPointError: the simulation left the finite numbers.
        """
        if self._observation is None:
            raise gym.error.ResetNeeded("call reset() before step()")
        action = check_action(action, self._size)
        if self.task.action_level == "torque":
            limit = self.task.torque_limit
            self._torque = [limit * a for a in action]
        else:
            self._torque = self._loop_torque(action)
        self._plant.step(self._torque)
        self._steps += 1
        t = self._steps * self.task.dt
        self._observation.action[:] = action
        observation, reward, lost = self._see(t)
        if reward != reward:
            raise diverged(t)
        if self.render_mode == "human":
            self.render()
        return observation, reward, lost, t >= self._end - self.task.dt / 2, self._info()

    def _see(self, t: float) -> tuple[np.ndarray, float, bool]:
        if self._noise is not None:
            at = self._steps % BLOCK
            if at == 0 and self._steps:
                self._noise = self._next_noise(self._steps)
            self._observation.noise[:] = self._noise[at]
        return self._observation(self._motion(), t)  # ty: ignore[not-callable]

    def _next_noise(self, step: int) -> np.ndarray | None:
        """Noise (BLOCK, 6) of the steps from ``step`` on, a multiple of ``BLOCK``."""
        if self._keys is None:
            return None
        return noise_block(self._noise_scale, self._keys, step)

    def _loop_torque(self, action: tuple) -> tuple:
        task, geometry = self.task, self.task.platform.geometry
        limits = (task.speed_limit, task.speed_limit, task.yaw_rate_limit)
        twist = tuple(a * limit for a, limit in zip(action, limits, strict=True))
        measured = tuple(self._plant.wheel_velocity.tolist())
        torque, self._integral = self.wheel_loop.torque(
            geometry.wheel_velocity(twist), measured, self._integral, task.dt, FLOAT
        )
        return torque

    def _info(self) -> dict[str, Any]:
        return {
            "time": self._steps * self.task.dt,
            "pose": self._motion()[:3].copy(),
            "reference_pose": self._observation.wanted.copy(),
            "torque": np.array(self._torque),
        }

    @property
    def wheel_angle(self) -> np.ndarray:
        """Wheel angles (n,), rad, that encoders show now; zero at the start of an episode."""
        return self._plant.wheel_angle

    def measurement(self) -> dict[str, Any]:
        """True values of the channels that a log records now; for ``youbot_env.recording``."""
        return {
            "time": self._steps * self.task.dt,
            "wheel_velocity": self._plant.wheel_velocity,
            "wheel_torque": np.array(self._torque),
            "pose": self._plant.pose,
            "reference": self._observation.twist.copy(),
        }

    def render(self):
        """Draw the scene from above; returns (H, W, 3) uint8 in mode ``rgb_array``."""
        if self.render_mode is None:
            gym.logger.warn("render() needs render_mode='rgb_array' or 'human' at gym.make")
            return None
        if self._view is None:
            from youbot_env.envs.rendering import TopView

            self._view = TopView(self.task.platform, self.render_mode, self.metadata["render_fps"])
        pose, t = self._plant.pose, self._steps * self.task.dt
        self._trail.append(pose[:2])
        if self._path is None:
            times = np.arange(0.0, min(self._end, DRAWN_SECONDS), 0.05)
            values = self._observation.values.tolist()
            ahead = self._followed.evaluate(values, times, NUMPY).pose[:2]
            self._path = np.stack(np.broadcast_arrays(*ahead, times)[:2], axis=1)
        wanted = self._observation.wanted
        heading = (math.cos(pose[2]), math.sin(pose[2]))
        error = self.task.error(tuple(pose.tolist()), heading, tuple(wanted.tolist()), FLOAT)
        caption = (
            f"t = {t:5.2f} s   position error {1e3 * math.hypot(*error[:2]):4.0f} mm   "
            f"heading error {math.degrees(error[2]):+5.1f} deg"
        )
        return self._view.draw(
            pose, wanted.copy(), np.array(self._trail), self._path,
            np.array(self._torque), self.task.torque_limit, caption,
        )  # fmt: skip

    def __getstate__(self) -> dict[str, Any]:
        """All but the window: a copy or a pickle goes on bit by bit, and opens one of its own."""
        return self.__dict__ | {"_view": None}

    def close(self) -> None:
        """Close the window."""
        if self._view is not None:
            self._view.close()
            self._view = None


class RollersEnv(TrackingEnv):
    """``TrackingEnv`` on a MuJoCo plant with real rollers: a stand-in for a real robot.

    Spaces, reward and ends are those of ``TrackingEnv``.  Friction, contact and the ripple of
    finite rollers are simulated and follow none of the project's formulas.
    """

    def _make_plant(self, model: Model):
        from youbot_env.rollers import RollersPlant

        return RollersPlant(model, self.task.dt)

    def _replace_robot(self, model: Model) -> None:
        self._plant = self._make_plant(model)
