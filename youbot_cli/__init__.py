"""The commands that users run, one module each, and what these share."""

# Words behind ``youbot``, and the module that they start.  Modules of commands have a ``start``,
# and the first line of their docstring stands in ``youbot --help``.
COMMANDS = {
    "record": "record",
    "convert": "convert",
    "identify": "identify",
    "compare": "compare",
    "diagnose": "diagnose",
    "improve": "improve",
    "workbench": "workbench",
    "design": "design",
    "calibrate": "calibrate_kinematics",
    "evaluate": "evaluate",
    "train": "train",
    "evaluate-policies": "evaluate_policies",
    "benchmark diagnosis": "benchmark_diagnosis",
    "benchmark identification": "benchmark_identification",
    "benchmark speed": "benchmark_speed",
}


def split_command(words: list[str]) -> tuple[str, list[str]]:
    """Split the words behind ``youbot`` into a key of ``COMMANDS`` and the options behind it.

    The key is empty where the words begin with no command.
    """
    for count in (2, 1):
        if " ".join(words[:count]) in COMMANDS:
            return " ".join(words[:count]), words[count:]
    return "", words
