"""The plant with real rollers, in MuJoCo."""

try:
    import mujoco as _mujoco  # noqa: F401
except ImportError as error:
    raise ImportError(
        "the plant with real rollers needs MuJoCo: pip install 'youbot-workbench[rollers]'"
    ) from error

from youbot_env.rollers.plant import RollersPlant

__all__ = ["RollersPlant"]
