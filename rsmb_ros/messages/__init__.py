"""Images and results to ROS messages and back, for the node and for bags alike (no rclpy)."""
