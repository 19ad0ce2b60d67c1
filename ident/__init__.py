"""From measured logs to parameters with honest intervals.

``from ident import Log, identify`` imports what is asked for and nothing more.  Logs may be
given as files, models as files or names, one or several; every result prints itself, has
``to_dict``, ``to_polars``, ``to_pandas`` and ``plot``.
"""

from __future__ import annotations

import importlib

_HOME = {
    "__version__": "youbot_env",
    "Log": "ident.log",
    "calibrate_kinematics": "ident.kinematics.calibration",
    "compare": "ident.comparison",
    "design_motion": "ident.design",
    "diagnose": "ident.diagnosis.diagnose",
    "identify": "ident.identification",
    "improve": "ident.improvement",
}
__all__ = [
    "Log",
    "calibrate_kinematics",
    "compare",
    "design_motion",
    "diagnose",
    "identify",
    "improve",
]


def __getattr__(name: str):
    if name not in _HOME:
        raise AttributeError(f"module 'ident' has no attribute {name!r}; it has {sorted(_HOME)}")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return __all__
