"""Nodes of ROS 2: a simulated vehicle, and a controller or policy on the topics of a vehicle (docs/ros2.md).

`vehicle` and `observer` need no ROS; the others need rclpy, from a sourced installation or the extra `ros2-node`.
"""
