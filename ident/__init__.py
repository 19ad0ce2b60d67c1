"""From measured logs to parameters with honest intervals.

``from ident import Log, identify`` imports what is asked for and nothing more.
"""

from __future__ import annotations

import importlib

_HOME = {
    "__version__": "youbot_env",
    "Log": "ident.log",
    "compare": "ident.comparison",
    "diagnose": "ident.diagnosis.verdict",
    "identify": "ident.identification",
}
__all__ = ["Log", "compare", "diagnose", "identify"]


def __getattr__(name: str):
    if name not in _HOME:
        raise AttributeError(f"module 'ident' has no attribute {name!r}; it has {sorted(_HOME)}")
    return getattr(importlib.import_module(_HOME[name]), name)
