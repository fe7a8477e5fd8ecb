"""A ROS 2 node that says where the robot is: it subscribes to images and publishes matches.

    python3 examples/ros2_node.py --ros-args -p model:=route.lvpr -r image:=/camera/image_raw

It needs ROS 2 (rclpy, cv_bridge, sensor_msgs, std_msgs) and lava-vpr in one Python. Topics:

    image   sensor_msgs/Image
    match   std_msgs/String: JSON for each image: time, place, place_name, position, probability, accepted, off_map

Parameters: model (a path), motion (any, forward or none), target_precision.
"""

from __future__ import annotations

import json
from typing import Any

import rclpy
from cv_bridge import CvBridge, CvBridgeError
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image
from std_msgs.msg import String

from lava_vpr import LavaVprError, Localizer


class LocalizerNode(Node):
    """Answers each image of the topic ``image`` on the topic ``match``."""

    def __init__(self) -> None:
        super().__init__("lava_vpr")
        self.declare_parameter("model", "")
        self.declare_parameter("motion", "any")
        self.declare_parameter("target_precision", 0.95)
        self._robot = Localizer(
            self.get_parameter("model").value,
            motion=self.get_parameter("motion").value,
            target_precision=self.get_parameter("target_precision").value,
        )
        self._bridge = CvBridge()
        self._publisher = self.create_publisher(String, "match", 10)
        # Of a camera that is faster than we are, the newest image is the one that counts.
        self.create_subscription(Image, "image", self.answer, qos_profile_sensor_data)

    def answer(self, message: Any) -> None:
        """Publish where one image was taken; one that cannot be read is a warning."""
        stamp = message.header.stamp.sec + message.header.stamp.nanosec / 1e9
        try:
            match = self._robot.update(self._bridge.imgmsg_to_cv2(message, "bgr8"), stamp)
        except (LavaVprError, CvBridgeError) as error:
            self.get_logger().warning(str(error))
            return
        self._publisher.publish(String(data=json.dumps(match.values() | {"position": match.position})))


def main() -> None:
    """Run the node until it is stopped."""
    rclpy.init()
    try:
        node = LocalizerNode()
    except LavaVprError as error:
        raise SystemExit(f"lava_vpr: {error}") from None
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
