"""The same as ``youbot convert``."""

from youbot_cli.convert import start

if __name__ == "__main__":
    start()
