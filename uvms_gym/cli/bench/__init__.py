"""`uvms bench`: how fast it is, by what, and beside whom."""

from uvms_gym.cli.bench.command import bench

__all__ = ["bench"]
