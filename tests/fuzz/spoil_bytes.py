"""Ways of spoiling the bytes of any file; each takes a generator and the bytes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

NOT_TEXT = (b"\xff\xfe", b"\xe9", b"\xc3\x28", b"\xed\xa0\x80", b"\x00", b"\xef\xbb\xbf")


def _piece(rng: np.random.Generator, data: bytes) -> tuple[int, int]:
    """Begin and end of a random piece, short more often than long."""
    length = int(min(len(data), 2 ** rng.uniform(0, 12)))
    begin = int(rng.integers(0, len(data) - length + 1))
    return begin, begin + length


def flip(rng, data: bytes) -> bytes:
    """Change one to 16 bytes."""
    changed = bytearray(data)
    for place in rng.integers(0, len(data), rng.integers(1, 17)) if data else ():
        changed[place] ^= int(rng.integers(1, 256))
    return bytes(changed)


def cut(rng, data: bytes) -> bytes:
    """End too early."""
    return data[: int(rng.integers(0, len(data) + 1))]


def leave_out(rng, data: bytes) -> bytes:
    """Leave a piece out."""
    begin, end = _piece(rng, data)
    return data[:begin] + data[end:]


def double(rng, data: bytes) -> bytes:
    """Write a piece twice."""
    begin, end = _piece(rng, data)
    return data[:end] + data[begin:]


def exchange(rng, data: bytes) -> bytes:
    """Exchange two pieces."""
    (a, b), (c, d) = sorted([_piece(rng, data), _piece(rng, data)])
    return data if b > c else data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:]


def fill(rng, data: bytes) -> bytes:
    """Fill a piece with one byte, as a disk does."""
    begin, end = _piece(rng, data)
    return data[:begin] + bytes([int(rng.choice([0, 255, 32, 10]))]) * (end - begin) + data[end:]


def insert(rng, data: bytes) -> bytes:
    """Insert bytes that are no text."""
    place = int(rng.integers(0, len(data) + 1))
    return data[:place] + NOT_TEXT[rng.integers(len(NOT_TEXT))] + data[place:]


def claim(rng, data: bytes) -> bytes:
    """Write a large number where a length may stand."""
    width, value = int(rng.choice([2, 4, 8])), int(rng.choice([31, 32, 40, 62, 63]))
    number = ((1 << value) - 1) & ((1 << 8 * width) - 1)
    place = int(rng.integers(0, max(1, len(data) - width)))
    order = "little" if rng.random() < 0.8 else "big"
    return data[:place] + number.to_bytes(width, order) + data[place + width :]


def replace_all(rng, data: bytes) -> bytes:
    """An empty file, one byte, noise, or zeros of the same length."""
    noise = rng.integers(0, 256, min(len(data), 5000), np.uint8).tobytes()
    return (b"", b"\n", noise, bytes(len(data)))[rng.integers(4)]


def append(rng, data: bytes) -> bytes:
    """Add what does not belong to the file."""
    return data + (data, b"\n\n", b"\x00" * 100, b"garbage")[rng.integers(4)]


BYTES: dict[str, Callable] = {
    "bytes changed": flip, "file cut off": cut, "piece left out": leave_out,
    "piece doubled": double, "pieces exchanged": exchange, "piece filled": fill,
    "no text inserted": insert, "length claimed": claim, "file replaced": replace_all,
    "something appended": append,
}  # fmt: skip
