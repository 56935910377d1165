# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 side of the planner; nothing else here imports rclpy or messages."""
