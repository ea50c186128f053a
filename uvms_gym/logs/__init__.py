"""Logs of vehicles: poses, IMU readings, joints and thruster commands, from tables and ROS bags."""

from uvms_gym.logs.channels import Attitude, Battery, Channel, Imu, Joints, Pose, Thrusters, Twist
from uvms_gym.logs.errors import LogError
from uvms_gym.logs.log import Log
from uvms_gym.logs.map import LogMap

__all__ = ["Attitude", "Battery", "Channel", "Imu", "Joints", "Log", "LogError", "LogMap", "Pose", "Thrusters", "Twist"]
