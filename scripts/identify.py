"""The same as ``youbot identify``."""

from youbot_cli.identify import start

if __name__ == "__main__":
    start()
