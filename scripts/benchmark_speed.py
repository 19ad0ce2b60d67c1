"""The same as ``youbot benchmark speed``."""

from youbot_cli.benchmark_speed import start

if __name__ == "__main__":
    start()
