"""Calls spread over processes, with one bar of progress."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import console
import given_effects
from joblib import Parallel, delayed


@dataclass(frozen=True)
class Crew:
    """Processes that share the work.

    Attributes:
        workers: how many at most.
        effects: file with effects of one's own that all of them have to know, if any.
    """

    workers: int
    effects: Path | None = None

    def run(
        self,
        title: str,
        calls: list[tuple[Callable, tuple]],
        weights: Iterable[float] | None = None,
    ) -> list[Any]:
        """Results of the calls in any order; progress in calls or by weight."""
        weights = list(weights) if weights is not None else [1.0] * len(calls)

        def one(call: Callable, arguments: tuple, share: float):
            return share, call(*arguments)

        todo = (delayed(one)(*call, share) for call, share in zip(calls, weights, strict=True))
        found, done = [], 0.0
        with console.progress(title, sum(weights)) as show:
            pool = Parallel(
                min(self.workers, len(calls)),
                return_as="generator_unordered",
                initializer=given_effects.load_effects,
                initargs=(self.effects,),
            )
            for share, result in pool(todo):
                found.append(result)
                done += share
                show(done)
        return found
