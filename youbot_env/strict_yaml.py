"""YAML as people mean it: ``5e-3`` is a number, and a key that stands twice is an error.

PyYAML follows YAML 1.1, where a number with exponent needs a point and a sign (``5.0e-3``), and
takes the last of equal keys without a word.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import yaml
from yaml.composer import ComposerError
from yaml.constructor import ConstructorError

# Values of a file with its aliases written out; models/identified.yaml has 200.  Nine lines of
# aliases of aliases make 10^9, which no message can quote.
MOST_VALUES = 1_000_000
# Bytes of a file, which take PyYAML about 5 s; models/identified.yaml has 3300.
MOST_BYTES = 500_000
_EXPONENT = re.compile(r"^[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$")


class _Loader(yaml.SafeLoader):
    def __init__(self, stream):
        super().__init__(stream)
        self._sizes: dict[int, int] = {}  # of nodes, aliases written out

    def compose_node(self, parent, index):
        alias = self.check_event(yaml.AliasEvent)
        node = super().compose_node(parent, index)
        if not alias:
            inside = [] if isinstance(node, yaml.ScalarNode) else node.value
            parts = [p for part in inside for p in (part if isinstance(part, tuple) else (part,))]
            self._sizes[id(node)] = 1 + sum(self._sizes[id(part)] for part in parts)
        # An alias of what is not finished yet is one of a whole that it is part of.
        if self._sizes.get(id(node), math.inf) > MOST_VALUES:
            raise ComposerError(
                None, None, f"more than {MOST_VALUES} values, or an alias of itself; write it out",
                node.start_mark,
            )  # fmt: skip
        return node

    def construct_mapping(self, node, deep=False):
        seen = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.value in seen:
                raise ConstructorError(
                    None, None, f"{key.value!r} stands twice; remove one", key.start_mark
                )
            seen.add(key.value if isinstance(key, yaml.ScalarNode) else id(key))
        return super().construct_mapping(node, deep)

    def construct_number(self, node):
        """A whole number, unless it is too long for arithmetic (or, from 4300 digits, for int)."""
        try:
            value = self.construct_yaml_int(node)
            float(value)
        except (OverflowError, ValueError) as error:
            what = f"{node.value[:12]}... with {len(node.value)} digits is no number to use"
            raise ConstructorError(None, None, f"{what}; correct it", node.start_mark) from error
        return value


_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_number)
_Loader.add_implicit_resolver("tag:yaml.org,2002:float", _EXPONENT, list("-+.0123456789"))


def read_yaml(path: Path) -> object:
    """Content of a YAML file.

    Raises:
        yaml.YAMLError: the file is too large, the text is not YAML, is nested too deeply, has a
            key twice in a mapping or a number without measure; says in which line where it can.
        UnicodeDecodeError: the file is not text.
    """
    if path.stat().st_size > MOST_BYTES:
        raise yaml.YAMLError(f"it has {path.stat().st_size} bytes, {MOST_BYTES} are allowed")
    text = path.read_text(encoding="utf-8")
    # A SafeLoader underneath: files of others cannot run code.
    try:
        return yaml.load(text, _Loader)
    except RecursionError as error:
        raise yaml.YAMLError("it is nested too deeply; write it with fewer levels") from error
    # PyYAML's constructors of dates, sets and the like fail in their own ways over wrong values.
    except (AttributeError, TypeError, ValueError, LookupError, ArithmeticError) as error:
        raise yaml.YAMLError(f"a value is not what its tag or form says ({error})") from error
