"""The same as ``youbot evaluate``."""

from youbot_cli.evaluate import start

if __name__ == "__main__":
    start()
