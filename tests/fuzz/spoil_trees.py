"""Ways of spoiling trees: YAML and JSON, the arrays of an NPZ, the tensors of a checkpoint."""

from __future__ import annotations

import copy
import io
import json
from collections.abc import Callable

import numpy as np
import yaml

VALUES = (
    None, True, "", "abc", -1, 0, 1, 1e300, -1e300, 1e-300, float("nan"), float("inf"), 10**400,
    10**18, [], {}, [[]], [1.0], {"a": 1}, "1e5", "5 kg", "\u00e9", "x" * 3000, [None], -0.0,
    "../../etc/passwd", 3.0, "1" * 5000,
)  # fmt: skip
# Appended to, or put before, the text of a file.
YAML_TEXTS = (
    "a: " + "[" * 2000 + "]" * 2000, "&a [*a]", "- &a x\n- *b", "name: &n [*n]",
    "!!python/object/apply:os.getcwd []", "? [1, 2]\n: 3", "? {a: 1}\n: 3", "name: 1\nname: 2",
    "a: &a [x,x,x,x,x,x,x,x]\nb: &b [*a,*a,*a,*a,*a,*a,*a,*a]\nc: &c [*b,*b,*b,*b,*b,*b,*b,*b]\n"
    "d: &d [*c,*c,*c,*c,*c,*c,*c,*c]\ne: &e [*d,*d,*d,*d,*d,*d,*d,*d]\n"
    "f: &f [*e,*e,*e,*e,*e,*e,*e,*e]\ng: &g [*f,*f,*f,*f,*f,*f,*f,*f]\n"
    "h: [*g,*g,*g,*g,*g,*g,*g,*g]",
    "<<: {name: b}", "--- \n---\n", "%YAML 9.9\n---\na: 1", "\t- a", "date: 2026-13-45",
    "n: 1:59:99", "b: !!binary x", "t: !!timestamp 9", "m: !!int x", "f: !!float abc", "n: 0o9",
    "<<: 3", "x: !!set {a, b}", "o: !!omap [1]", "p: !!pairs [[1]]", "12:30:45: 3", "= : 3",
)  # fmt: skip


def places(tree) -> list[tuple]:
    """Every (container, key) of a tree, each container once: aliases may make rings."""
    found, seen, open_ = [], set(), [tree]
    while open_:
        one = open_.pop()
        if id(one) in seen or not isinstance(one, dict | list):
            continue
        seen.add(id(one))
        pairs = list(one.items() if isinstance(one, dict) else enumerate(one[:60]))
        found += [(one, key) for key, _ in pairs]
        open_ += [value for _, value in pairs]
    return found


def spoil_tree(rng, tree) -> object:
    """A copy with one thing changed."""
    tree = copy.deepcopy(tree)
    spots = places(tree)
    if not spots or rng.random() < 0.02:
        return copy.deepcopy(VALUES[rng.integers(len(VALUES))])
    # Few spots lie near the root, where much hangs on them.
    level = [s for s in spots if s[0] is tree] if rng.random() < 0.3 else spots
    parent, key = level[rng.integers(len(level))]
    how = rng.integers(8)
    if how <= 3:
        parent[key] = copy.deepcopy(VALUES[rng.integers(len(VALUES))])
    elif how == 4:
        del parent[key]
    elif how == 5:
        if isinstance(parent, dict):
            new = (str(key).upper(), 3, None, f"{key}_", True)[rng.integers(5)]
            parent[new] = parent[key] if rng.random() < 0.5 else parent.pop(key)
        else:
            parent.insert(int(rng.integers(len(parent) + 1)), copy.deepcopy(parent[key]))
    elif how == 6:
        other, place = spots[rng.integers(len(spots))]
        value, parent[key] = parent[key], copy.deepcopy(other[place])
        if other is parent:
            other[place] = value
    else:
        parent[key] = [parent[key]] if rng.random() < 0.5 else {"value": parent[key]}
    return tree


def yaml_tree(rng, data: bytes) -> bytes:
    try:
        tree = yaml.safe_load(data.decode("utf-8", "replace"))
        return yaml.safe_dump(spoil_tree(rng, tree), allow_unicode=True).encode()
    except Exception:  # an earlier step has left no tree
        return data


def yaml_text(rng, data: bytes) -> bytes:
    added = YAML_TEXTS[rng.integers(len(YAML_TEXTS))].encode()
    how = rng.integers(3)
    return (data + b"\n" + added, added + b"\n" + data, added)[how]


def yaml_lines(rng, data: bytes) -> bytes:
    """A line less, twice, further in, or with another value."""
    lines = data.decode("utf-8", "replace").splitlines()
    if not lines:
        return data
    k, how = int(rng.integers(len(lines))), rng.integers(5)
    if how == 0:
        del lines[k]
    elif how == 1:
        lines.insert(k, lines[k])
    elif how == 2:
        lines[k] = "  " * int(rng.integers(1, 4)) + lines[k]
    elif how == 3:
        lines[k] = lines[k].lstrip()
    else:
        name = lines[k].partition(":")[0]
        values = (".nan", ".inf", "1e400", "~", "[1", "{a", "'", "*x", "0x1F", "1_0", "yes", "@")
        lines[k] = f"{name}: {values[rng.integers(len(values))]}"
    return "\n".join(lines).encode() + b"\n"


def json_tree(rng, data: bytes) -> bytes:
    try:
        tree = json.loads(data)
    except ValueError:
        return data
    return json.dumps(spoil_tree(rng, tree)).encode()


def json_text(rng, data: bytes) -> bytes:
    texts = (b"[" * 100_000, b'{"a":' * 100_000, b"1" * 5000, b"NaN", b'"\\ud800"', b"{}", b"[]",
             data[:-2] + b', "kind": 3}', data.replace(b"1", b"1" * 500, 1))  # fmt: skip
    return texts[rng.integers(len(texts))]


YAML: dict[str, Callable] = {
    "entries changed": yaml_tree, "text added": yaml_text, "lines changed": yaml_lines,
}  # fmt: skip
JSON: dict[str, Callable] = {"entries changed": json_tree, "text replaced": json_text}


def spoil_array(rng, array: np.ndarray) -> np.ndarray:
    """An array of another shape, another type, or with values that cannot be."""
    flat = array.astype(float).reshape(-1).copy()
    other = (
        lambda: array.astype(complex), lambda: array.astype(str), lambda: array.astype(np.int64),
        lambda: array[None], lambda: array.reshape(-1), lambda: np.atleast_1d(array)[:0],
        lambda: np.atleast_1d(array)[..., :1],
        lambda: array.T, lambda: np.array(3.0), lambda: np.full(array.shape, np.nan, np.float32),
        lambda: array * np.float32(1e38), lambda: array.astype(np.float16),
        lambda: array.astype("datetime64[s]"), lambda: np.zeros(array.shape, "V4"),
        lambda: np.where(np.arange(flat.size) == 0, np.inf, flat).reshape(array.shape),
    )  # fmt: skip
    return other[rng.integers(len(other))]()


def npz_arrays(rng, data: bytes) -> bytes:
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except Exception:
        return data
    if not arrays:
        return data
    name, how = list(arrays)[rng.integers(len(arrays))], rng.integers(6)
    if how == 0:
        del arrays[name]
    elif how == 1:
        arrays[f"{name}_x"] = arrays[name]
    elif how == 2:
        arrays[name] = np.array([{"a": 1}], object)  # would need unpickling
    else:
        with np.errstate(all="ignore"):
            arrays[name] = spoil_array(rng, arrays[name])
    stream = io.BytesIO()
    (np.savez_compressed if rng.random() < 0.3 else np.savez)(stream, **arrays)
    return stream.getvalue()


def npz_claims(rng, data: bytes) -> bytes:
    """The header of an array claims another shape; as long as before."""
    shapes = (b"(99999999999,)", b"(9, 99999999)", b"(-1, 26)", b"(2**60,)", b"None", b"(1.5,)")
    place = data.find(b"'shape': ", int(rng.integers(0, len(data) // 2 + 1)))
    end = data.find(b"}", place)
    if place < 0 or end < 0:
        return data
    new = b"'shape': " + shapes[rng.integers(len(shapes))] + b", "
    return data[:place] + new.ljust(end - place)[: max(end - place, len(new))] + data[end:]


NPZ: dict[str, Callable] = {"arrays changed": npz_arrays, "length claimed": npz_claims}


def tensors(rng, data: bytes) -> bytes:
    """A checkpoint in which something stands elsewhere, is missing, or has another shape."""
    import torch

    try:
        tree = torch.load(io.BytesIO(data), weights_only=True)
    except Exception:
        return data
    spots = places(tree)
    parent, key = spots[rng.integers(len(spots))]
    if isinstance(parent[key], torch.Tensor) and rng.random() < 0.7:
        with np.errstate(all="ignore"):
            spoiled = spoil_array(rng, parent[key].numpy())
        if spoiled.dtype.kind in "fic":
            parent[key] = torch.as_tensor(np.ascontiguousarray(spoiled))
    elif key == "text" and parent is tree:
        parent[key] = json_tree(rng, parent[key].encode()).decode()
    else:
        tree = spoil_tree(rng, tree)
    stream = io.BytesIO()
    torch.save(tree, stream)
    return stream.getvalue()


CHECKPOINT: dict[str, Callable] = {"entries changed": tensors}
