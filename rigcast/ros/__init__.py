"""Frames as ROS 2 messages: in bags, without ROS, and live, with rclpy."""
