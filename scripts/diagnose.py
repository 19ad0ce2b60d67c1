"""The same as ``youbot diagnose``."""

from youbot_cli.diagnose import start

if __name__ == "__main__":
    start()
