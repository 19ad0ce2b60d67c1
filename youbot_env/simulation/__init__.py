"""Simulation of one robot: the analytic plant, on-board wheel loops and sensors."""

from youbot_env.simulation.analytic import AnalyticPlant, choose_substeps
from youbot_env.simulation.closed_loop import record_closed_loop
from youbot_env.simulation.rows import ROWS, Instrument, LoopInstants, pick_rows
from youbot_env.simulation.sensors import IDEAL, Sensors
from youbot_env.simulation.wheel_loop import WheelLoop

__all__ = [
    "IDEAL",
    "ROWS",
    "AnalyticPlant",
    "Instrument",
    "LoopInstants",
    "Sensors",
    "WheelLoop",
    "choose_substeps",
    "pick_rows",
    "record_closed_loop",
]
