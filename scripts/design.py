"""The same as ``youbot design``."""

from youbot_cli.design import start

if __name__ == "__main__":
    start()
