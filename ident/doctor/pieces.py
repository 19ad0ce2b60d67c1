"""Contiguous pieces that gaps and cuts have left too short to use."""

from __future__ import annotations

import numpy as np

from ident.doctor.record import Record

SHORTEST = 10  # samples


def check_pieces(record: Record) -> None:
    """Leave out pieces of a few samples between two breaks."""
    edges = np.flatnonzero(np.concatenate([[True], record.breaks[1:], [True]]))
    lengths = np.diff(edges)
    short = lengths < SHORTEST
    if not short.any() or len(lengths) == 1:
        return
    where = record.place(int(edges[np.flatnonzero(short)[0]]))
    if short.all():
        record.refuse(
            "pieces",
            f"{len(lengths)} pieces, none of {SHORTEST} samples",
            where,
            "record again",
            final=True,
        )
        return
    record.drop(np.repeat(short, lengths), split=True)
    what = f"{int(short.sum())} pieces of less than {SHORTEST} samples between two breaks"
    record.fixed("pieces", what, where, "left out")
