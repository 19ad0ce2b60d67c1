"""Gather the pages of the documentation site: guides, README and its like, examples, reference.

``make docs`` runs this before the site is built, so that whatever builds it only finds Markdown.
Formulas become MathML here: browsers draw it without a script or a font from elsewhere.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import shutil
import sys
from pathlib import Path

from latex2mathml.converter import convert

ROOT = Path(__file__).resolve().parent.parent
# Files of the root by their name in the site, where LICENSE needs an ending to be shown as text.
COPIED = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "CONTRIBUTING.md",
    "CHANGELOG.md": "CHANGELOG.md",
    "SECURITY.md": "SECURITY.md",
    "CITATION.cff": "CITATION.cff",
    "LICENSE": "LICENSE.txt",
}
# What the reference shows: the ``__all__`` of packages, and of modules without one every public
# class and function that is defined there.
SHOWN = {
    "ident": ("ident", "ident.loaders"),
    "controllers": ("controllers", "controllers.rl_policy"),
    "youbot_env": (
        "youbot_env.envs.tracking",
        "youbot_env.envs.vector",
        "youbot_env.envs.randomization",
        "youbot_env.model_file",
        "youbot_env.model",
        "youbot_env.parameters",
        "youbot_env.platform",
        "youbot_env.platform_file",
        "youbot_env.effects",
        "youbot_env.references",
        "youbot_env.simulation",
        "youbot_env.rollers",
        "youbot_env.recording",
    ),
}
FORMULA = re.compile(r"\$`(.+?)`\$")


def gather(target: Path) -> None:
    """Write all pages and pictures into a folder, which is made anew."""
    shutil.rmtree(target, ignore_errors=True)
    (target / "reference").mkdir(parents=True)
    for picture in (ROOT / "docs").glob("*.png"):
        shutil.copy(picture, target)
    pages = {page.name: page.read_text("utf-8") for page in (ROOT / "docs").glob("*.md")}
    for here, there in COPIED.items():
        text = (ROOT / here).read_text("utf-8")
        pages[there] = text.replace("](docs/", "](").replace("](LICENSE)", "](LICENSE.txt)")
    pages["examples.md"] = examples()
    pages |= {f"reference/{name}.md": reference(name) for name in SHOWN}
    for name, text in pages.items():
        text = text.replace("](../SECURITY.md", "](SECURITY.md")
        text = FORMULA.sub(lambda found: convert(found[1]), text)
        (target / name).write_text(text, encoding="utf-8")


def examples() -> str:
    """All examples on one page, each under the first line of its docstring."""
    parts = [
        "# Examples\n\nEach is a file of `examples`, runs in any folder in less than a minute, and "
        "writes what it makes into `runs` there. The tests run all of them.\n"
    ]
    for file in sorted((ROOT / "examples").glob("*.py")):
        code = file.read_text("utf-8")
        title = (ast.get_docstring(ast.parse(code)) or "").splitlines()[0]
        name = file.stem.replace("_", " ").capitalize()
        body = code.split('"""\n\n', 1)[1]
        parts.append(f"## {name}\n\n{title} (`examples/{file.name}`)\n\n```python\n{body}```\n")
    return "\n".join(parts)


def reference(name: str) -> str:
    """The page of a package: each public name, and the results that its functions return."""
    parts, shown = [f"# {name}\n"], set()
    for module_name in SHOWN[name]:
        module = importlib.import_module(module_name)
        parts.append(f"{inspect.getdoc(module)}\n" if module_name != name else "")
        for item in public(module):
            for one in (item, returned(item, name)):
                if one is not None and one not in shown:
                    shown.add(one)
                    parts.append(f"::: {one.__module__}.{one.__qualname__}\n")
    return "\n".join(parts)


def public(module) -> list:
    """Classes and functions of a module or package that are meant for users."""
    names = getattr(module, "__all__", None)
    if names is None:
        names = [
            n for n, item in vars(module).items()
            if n[0] != "_" and getattr(item, "__module__", None) == module.__name__
        ]  # fmt: skip
    items = [getattr(module, n) for n in names]
    return [item for item in items if inspect.isclass(item) or inspect.isfunction(item)]


def returned(item, package: str):
    """The class of this package that a function returns, if it returns one."""
    if not inspect.isfunction(item):
        return None
    function = inspect.unwrap(item)
    kind = function.__globals__.get(function.__annotations__.get("return"))
    ours = inspect.isclass(kind) and kind.__module__.startswith(f"{package}.")
    return kind if ours else None


if __name__ == "__main__":
    gather(Path(sys.argv[1]))
