"""Node of ROS 2 that prints the displacement of the target and warns when it leaves a sphere.

    ros2 run rmw_zenoh_cpp rmw_zenohd &
    trinocular track --sim --zenoh &
    RMW_IMPLEMENTATION=rmw_zenoh_cpp python3 displacement_node.py --ros-args -p limit_mm:=5.0
"""

import math

import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node


class DisplacementNode(Node):
    """Subscriber of /trinocular/displacement."""

    def __init__(self):
        super().__init__("displacement_node")
        self.declare_parameter("limit_mm", 5.0)
        self.create_subscription(
            PoseWithCovarianceStamped, "/trinocular/displacement", self.displaced, 10)

    def displaced(self, message):
        """Prints one displacement in mm, with its standard deviation per axis."""
        position, covariance = message.pose.pose.position, message.pose.covariance
        displacement_mm = [1e3 * value for value in (position.x, position.y, position.z)]
        sigma_mm = [1e3 * math.sqrt(covariance[7 * axis]) for axis in range(3)]
        text = ", ".join(f"{axis} {mm:.3f} ± {sigma:.3f}"
                         for axis, mm, sigma in zip("xyz", displacement_mm, sigma_mm))
        limit_mm = self.get_parameter("limit_mm").value
        if math.hypot(*displacement_mm) > limit_mm:
            self.get_logger().warning(f"{text} mm: beyond {limit_mm} mm")
        else:
            self.get_logger().info(f"{text} mm")


def main():
    """Runs the node until Ctrl-C."""
    rclpy.init()
    node = DisplacementNode()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()


if __name__ == "__main__":
    main()
