"""Who answers: the diagnosis of this project, and the baselines.

A method is a function ``(fit, verify, seed) -> answer`` of logs of one robot, with the answer in
the form of ``Diagnosis.as_dict``: ``verdict`` and ``named`` at least.
"""

from __future__ import annotations

from typing import Any

from ident.log import Log


def diagnosis(fit: Log | list[Log], verify: Log, seed: int) -> dict[str, Any]:
    """Ask ``ident.diagnose``, which sees the verifying record only to report errors on it."""
    from ident import diagnose

    return diagnose(fit, model="nominal", test=verify, seed=seed).as_dict()


def pysindy(fit: Log, verify: Log, seed: int) -> dict[str, Any]:
    """Sparse regression by PySINDy over the columns of all effects."""
    from ident.benchmark.baselines import sparse_regression

    return sparse_regression(fit, verify)


def sysidentpy(fit: Log, verify: Log, seed: int) -> dict[str, Any]:
    """Terms that SysIdentPy's forward regression picks for a NARX model."""
    from ident.benchmark.baselines import forward_regression

    return forward_regression(fit, verify)


METHODS = {"diagnosis": diagnosis, "pysindy": pysindy, "sysidentpy": sysidentpy}
