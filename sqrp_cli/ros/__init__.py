"""What robots and cameras speak: messages of ROS, and the transports that carry them."""
