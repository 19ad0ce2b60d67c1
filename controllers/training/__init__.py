"""Reinforcement learning: what is learned on, by what, and how the result is judged.

The only room of ``controllers`` that makes environments.  Nothing here is needed to run a policy;
Stable-Baselines3 and torch are imported where they are used.
"""
