"""The same as ``youbot improve``."""

from youbot_cli.improve import start

if __name__ == "__main__":
    start()
