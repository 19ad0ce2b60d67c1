"""Pictures of the simulated robot, drawn off screen by MuJoCo."""

from __future__ import annotations

import mujoco
import numpy as np


class Camera:
    """A camera that follows the robot from behind and above.

    Args:
        model: compiled model.
        width, height: size of the pictures, px.
        reach: size of the robot, m; sets the distance.

    Raises:
        RuntimeError: MuJoCo finds no way to draw off screen.
    """

    def __init__(self, model: mujoco.MjModel, width: int, height: int, reach: float):
        self.size, self._model = (width, height), model
        try:
            self._renderer = mujoco.Renderer(model, height, width)
        except ValueError:
            raise  # a picture larger than 1920 x 1080
        except Exception as error:  # every OpenGL backend raises its own
            raise RuntimeError(
                f"MuJoCo cannot draw off screen ({error}); without a display set the environment "
                "variable MUJOCO_GL=egl (or osmesa, in software) before Python starts, and "
                "install that library (Debian, Ubuntu: libegl1 or libosmesa6)"
            ) from error
        self._view = mujoco.MjvCamera()
        self._view.distance, self._view.elevation, self._view.azimuth = 4 * reach, -30.0, 30.0

    def picture(self, data: mujoco.MjData, pose: np.ndarray) -> np.ndarray:
        """Draw the state with the robot at pose (x, y, yaw) in the middle: (height, width, 3)."""
        # Positions only: solving for forces here would change the start of the next solution.
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_camlight(self._model, data)
        self._view.lookat[:2] = pose[:2]
        self._renderer.update_scene(data, camera=self._view)
        return self._renderer.render()
