"""The same as ``youbot benchmark identification``."""

from youbot_cli.benchmark_identification import start

if __name__ == "__main__":
    start()
