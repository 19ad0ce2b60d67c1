"""The same as ``youbot workbench``."""

from youbot_cli.workbench import start

if __name__ == "__main__":
    start()
