"""The robot: platform, physics, effects, simulation and Gymnasium environments."""
