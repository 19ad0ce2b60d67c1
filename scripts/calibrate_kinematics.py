"""The same as ``youbot calibrate``."""

from youbot_cli.calibrate_kinematics import start

if __name__ == "__main__":
    start()
