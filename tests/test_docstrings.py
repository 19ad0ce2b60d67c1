"""What docstrings say about arguments and attributes is what signatures and classes have."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("youbot_env", "ident", "controllers", "youbot_cli", "youbot_workbench")


def section(docstring, title):
    """Lines of a section, without its indentation; None where there is none."""
    lines = docstring.splitlines()
    if f"{title}:" not in lines:
        return None
    first = lines.index(f"{title}:") + 1
    body = []
    for line in lines[first:]:
        if line and not line.startswith(" "):
            break
        body.append(line.removeprefix("    "))
    return body


def told(body):
    """Names that the entries of a section begin with; ``a, b: ...`` are two."""
    entries = [line for line in body if line and not line.startswith(" ")]
    names = []
    for entry in entries:
        head, colon, _ = entry.partition(":")
        assert colon, f"entry without a colon: {entry!r}"
        names += [name.lstrip("*") for name in head.split(", ")]
    return names


def parameters(function, method):
    """Names of what a caller gives: without self, cls and the canvas of ``@figure(...)``."""
    a, decorators = function.args, [ast.unparse(d) for d in function.decorator_list]
    bound = method and "staticmethod" not in decorators
    bound = bound or any(decorator.startswith("figure(") for decorator in decorators)
    plain = [*a.posonlyargs, *a.args][int(bound) :]
    extra = [one for one in (a.vararg, a.kwarg) if one]
    return [one.arg for one in (*plain, *a.kwonlyargs, *extra)]


def public(tree, method=False):
    """(function, whether it is a method) of all that is public in a module."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and (node.name[0] != "_" or node.name == "__init__"):
            yield node, method
        elif isinstance(node, ast.ClassDef) and node.name[0] != "_":
            yield from public(node, method=True)


def faults(source):
    """What is wrong in a module's docstrings, a line each."""
    for function, method in public(ast.parse(source)):
        body = section(ast.get_docstring(function) or "", "Args")
        if body is None:
            continue
        names, real = told(body), parameters(function, method)
        if sorted(names) != sorted(real):
            yield f"{function.name}, line {function.lineno}: tells of {names}, has {real}"


@pytest.mark.parametrize("package", PACKAGES)
def test_docstrings_name_exactly_the_parameters(package):
    wrong, read = [], 0
    for file in sorted((ROOT / package).rglob("*.py")):
        source = file.read_text("utf-8")
        read += source.count("Args:\n")
        wrong += [f"{file.relative_to(ROOT)}: {fault}" for fault in faults(source)]
    assert not wrong, "\n".join(wrong)
    assert read > 0 or package in ("youbot_cli", "youbot_workbench")


DOCUMENTED = '''
class Thing:
    def made(self, first, *rest, last=0, **more):
        """Do it.

        Args:
            {args}
        """
'''


@pytest.mark.parametrize(
    ("args", "sound"),
    [
        ("first, last: numbers.\n            *rest: others.\n            **more: options.", True),
        ("first: one.\n            *rest: others.\n            last: zero.", False),
        ("first, last, gone: numbers.\n            rest: o.\n            more: options.", False),
    ],
)
def test_a_missing_and_a_surplus_name_are_found(args, sound):
    assert (not list(faults(DOCUMENTED.format(args=args)))) == sound
