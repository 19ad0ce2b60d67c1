"""The same as ``youbot record``."""

from youbot_cli.record import start

if __name__ == "__main__":
    start()
