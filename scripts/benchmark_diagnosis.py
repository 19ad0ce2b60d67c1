"""The same as ``youbot benchmark diagnosis``."""

from youbot_cli.benchmark_diagnosis import start

if __name__ == "__main__":
    start()
