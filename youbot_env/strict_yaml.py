"""YAML as people mean it: ``5e-3`` is a number, and a key that stands twice is an error.

PyYAML follows YAML 1.1, where a number with exponent needs a point and a sign (``5.0e-3``), and
takes the last of equal keys without a word.
"""

from __future__ import annotations

import re
from pathlib import Path

import yaml

_EXPONENT = re.compile(r"^[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$")


class _Loader(yaml.SafeLoader):
    def construct_mapping(self, node, deep=False):
        seen = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.value in seen:
                raise yaml.constructor.ConstructorError(
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
            raise yaml.constructor.ConstructorError(
                None, None, f"{what}; correct it", node.start_mark
            ) from error
        return value


_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_number)
_Loader.add_implicit_resolver("tag:yaml.org,2002:float", _EXPONENT, list("-+.0123456789"))


def read_yaml(path: Path) -> object:
    """Content of a YAML file.

    Raises:
        yaml.YAMLError: the text is not YAML, is nested too deeply, has a key twice in a mapping or
            a number without measure; says in which line where it can.
        UnicodeDecodeError: the file is not text.
    """
    text = path.read_text(encoding="utf-8")
    # A SafeLoader underneath: files of others cannot run code.
    try:
        return yaml.load(text, _Loader)
    except RecursionError as error:
        raise yaml.YAMLError("it is nested too deeply; write it with fewer levels") from error
    # PyYAML's constructors of dates, sets and the like fail in their own ways over wrong values.
    except (AttributeError, TypeError, ValueError, LookupError, ArithmeticError) as error:
        raise yaml.YAMLError(f"a value is not what its tag or form says ({error})") from error
