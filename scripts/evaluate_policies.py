"""The same as ``youbot evaluate-policies``."""

from youbot_cli.evaluate_policies import start

if __name__ == "__main__":
    start()
