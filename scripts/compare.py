"""The same as ``youbot compare``."""

from youbot_cli.compare import start

if __name__ == "__main__":
    start()
