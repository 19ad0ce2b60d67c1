"""The robot: platform, physics, effects, simulation and Gymnasium environments.

Importing this package registers ``YouBot-v0`` (equations of the paper, native vector environment)
and ``YouBotRollers-v0`` (MuJoCo, real rollers).
"""

from importlib.metadata import PackageNotFoundError, version

from gymnasium.envs.registration import register

try:
    __version__ = version("youbot-workbench")
except PackageNotFoundError:  # a clone on the path that was never installed
    __version__ = "0+unknown"

register(
    id="YouBot-v0",
    entry_point="youbot_env.envs.tracking:TrackingEnv",
    vector_entry_point="youbot_env.envs.vector:TrackingVectorEnv",
    max_episode_steps=1000,
)
register(
    id="YouBotRollers-v0",
    entry_point="youbot_env.envs.tracking:RollersEnv",
    max_episode_steps=1000,
)
