"""Calls a CasADi function on arrays: quickly for one robot, by columns for many."""

from __future__ import annotations

import casadi as ca
import numpy as np


class Columns:
    """A function of dense vectors, evaluated for one robot or for one column of each a robot.

    One robot goes through buffers that CasADi reads and writes in place, which takes
    microseconds; many robots go through CasADi's own map.

    Attributes:
        function: the function itself.
    """

    def __init__(self, function: ca.Function):
        self.function = function
        self._inputs = [np.zeros(function.nnz_in(i)) for i in range(function.n_in())]
        self._outputs = [np.zeros(function.nnz_out(i)) for i in range(function.n_out())]
        self._buffer, self._call = function.buffer()
        for index, array in enumerate(self._inputs):
            self._buffer.set_arg(index, memoryview(array))  # ty: ignore[invalid-argument-type]
        for index, array in enumerate(self._outputs):
            self._buffer.set_res(index, memoryview(array))  # ty: ignore[invalid-argument-type]

    def one(self, *inputs: np.ndarray) -> list[np.ndarray]:
        """Evaluate for one robot; the results are overwritten by the next call."""
        for place, value in zip(self._inputs, inputs, strict=True):
            place[:] = value
        self._call()
        return self._outputs

    def many(self, *inputs: np.ndarray) -> list[np.ndarray]:
        """Evaluate for inputs with one row a robot, or (1, size) where all share a value.

        Returns:
            One array a result, (robots, size).
        """
        robots = max(len(value) for value in inputs)
        if robots == 1:
            return [part[None].copy() for part in self.one(*(value[0] for value in inputs))]
        columns = [np.broadcast_to(value, (robots, value.shape[1])).T for value in inputs]
        return [np.asarray(part).T for part in self.function.map(robots).call(columns)]
