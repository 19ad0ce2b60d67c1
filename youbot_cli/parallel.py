"""Pieces of long work spread over processes, with one bar of progress; finished ones are kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from youbot_cli import console, effect_options
from youbot_cli.pieces import Pieces


@dataclass(frozen=True)
class Piece:
    """One call.

    Attributes:
        name: says which among all pieces of the command.
        call, arguments: what is done.
        weight: its share of the progress.
    """

    name: str
    call: Callable
    arguments: tuple
    weight: float = 1.0


@dataclass(frozen=True)
class Parallel:
    """Processes that share the work.

    Attributes:
        workers: how many at most.
        pieces: where finished pieces are kept.
        effects: file with effects of one's own that all of them have to know, if any.
        cluster: address of a Dask scheduler whose workers share it instead, if any.
    """

    workers: int
    pieces: Pieces
    effects: Path | None = None
    cluster: str | None = None

    def run(
        self,
        title: str,
        work: Sequence[Piece],
        pack: Callable[[Any], Any] = lambda result: result,
        unpack: Callable[[Any], Any] = lambda kept: kept,
    ) -> list[Any]:
        """Results of the pieces in their order; those finished before are not done again.

        Args:
            title: of the progress.
            work: pieces.
            pack: turns a result into types that JSON has.
            unpack: turns that into a result again; so every result comes, kept before or not.

        Raises:
            ChildProcessError: the process of one piece was killed again and again.
        """
        from ident.workers import spread

        found = {piece.name: self.pieces.find(f"{title}, {piece.name}") for piece in work}
        left = [piece for piece in work if found[piece.name] is None]
        done = sum(piece.weight for piece in work) - sum(piece.weight for piece in left)
        with console.progress(title, sum(piece.weight for piece in work)) as show:
            show(done)
            calls = [(piece.call, piece.arguments) for piece in left]
            names = [f"{title}, {piece.name}" for piece in left]
            prepare = (effect_options.load_effects, (self.effects,))
            workers = max(1, min(self.workers, len(left)))
            for number, result in spread(calls, names, workers, prepare, self.cluster):
                piece = left[number]
                found[piece.name] = self.pieces.keep(names[number], pack(result))
                done += piece.weight
                show(done)
        return [unpack(found[piece.name]) for piece in work]
