# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 side of the driver; nothing else imports rclpy or messages."""
