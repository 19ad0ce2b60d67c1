"""``youbot``: one command for everything; the module of a command is imported when it is run."""

from __future__ import annotations

import ast
import difflib
import importlib
import sys
from importlib.resources import files

from youbot_cli import COMMANDS, split_command

USAGE = "Usage: youbot COMMAND [OPTIONS]; youbot COMMAND --help says more"
HELP = ("-h", "--help")


def main() -> None:
    """Run the command that the command line names."""
    command, options = split_command(sys.argv[1:])
    if command:
        # What results say of their origin, and what the help shows as the name.
        sys.argv = [f"youbot {command}", *options]
        importlib.import_module(f"youbot_cli.{COMMANDS[command]}").start()
    elif not options or options[0] in HELP:
        print(help_of(list(COMMANDS)))
    elif options == ["--version"]:
        from youbot_env import __version__

        print(f"youbot-workbench {__version__}")
    else:
        inside = [name for name in COMMANDS if name.split()[0] == options[0]]
        if inside and (options[1:2] == [] or options[1] in HELP):
            print(help_of(inside))
        else:
            sys.exit(unknown(options, inside))


def help_of(commands: list[str]) -> str:
    """Usage, and a line for each of some commands."""
    width = max(map(len, commands))
    return "\n".join([USAGE, "", *(f"  {name:{width}}  {line(name)}" for name in commands)])


def line(command: str) -> str:
    """First line of the docstring of a command's module, which is read without importing it."""
    source = (files("youbot_cli") / f"{COMMANDS[command]}.py").read_text(encoding="utf-8")
    return ast.get_docstring(ast.parse(source)).partition("\n")[0]


def unknown(words: list[str], inside: list[str]) -> int:
    """Say that there is no such command; returns the exit status of bad input."""
    asked = " ".join(words[:2] if inside else words[:1])
    known = inside or list(COMMANDS)
    near = difflib.get_close_matches(asked, known, 1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    print(f"error: no command {asked!r}; {hint}known: {', '.join(known)}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    main()
