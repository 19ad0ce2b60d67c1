"""The same as ``youbot train``."""

from youbot_cli.train import start

if __name__ == "__main__":
    start()
