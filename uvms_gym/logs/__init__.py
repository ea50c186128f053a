"""Logs of vehicles, from tables, ROS bags and autopilots, and recordings of simulated ones."""

from uvms_gym.logs.channels import Attitude, Battery, Channel, Imu, Joints, Pose, Thrusters, Twist
from uvms_gym.logs.errors import LogError
from uvms_gym.logs.log import Log
from uvms_gym.logs.map import LogMap
from uvms_gym.logs.recorder import Recorder

__all__ = [
    "Attitude",
    "Battery",
    "Channel",
    "Imu",
    "Joints",
    "Log",
    "LogError",
    "LogMap",
    "Pose",
    "Recorder",
    "Thrusters",
    "Twist",
]
