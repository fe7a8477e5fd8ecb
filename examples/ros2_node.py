"""A ROS 2 node that says where the robot is: it subscribes to images and publishes matches.

    python3 examples/ros2_node.py --ros-args -p model:=route.lvpr -r image:=/camera/image_raw

It needs ROS 2 (rclpy, cv_bridge, sensor_msgs, std_msgs, geometry_msgs) and lava-vpr in one Python. Topics:

    image         sensor_msgs/Image
    match         std_msgs/String, JSON: time, place, place_name, position, probability, accepted, off_map
    initialpose   geometry_msgs/PoseWithCovarianceStamped, of accepted images, if the map has positions
    rtabmap/info  rtabmap_msgs/Info: posterior and loop closure of each image, if rtabmap_msgs is installed
    rtabmap/link  rtabmap_msgs/Link, of accepted images, if both

All but ``match`` need a motion other than none. Parameters: model (a path), motion (any, forward or none),
target_precision.
"""

from __future__ import annotations

import json
from importlib import import_module
from typing import Any

import numpy as np
import rclpy
from cv_bridge import CvBridge, CvBridgeError
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image
from std_msgs.msg import String

from lava_vpr import LavaVprError, Localizer
from lava_vpr.exchange.ros import TOPICS, Messages


def type_of(kind: str) -> Any:
    """The class of a message, named as ``package/msg/Name``."""
    package, _, name = kind.split("/")
    return getattr(import_module(f"{package}.msg"), name)


def made(kind: str, /, **fields: Any) -> Any:
    """A message; rclpy takes lists where we have arrays."""
    plain = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in fields.items()}
    return type_of(kind)(**plain)


def installed(kind: str) -> bool:
    """Whether messages of this type can be made here."""
    try:
        type_of(kind)
    except ImportError:
        return False
    return True


class LocalizerNode(Node):
    """Answers each image of the topic ``image``."""

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
        known = [topic for topic, kind in TOPICS.items() if installed(kind)]
        self._messages, self._number = Messages(self._robot.model, made, known), 0
        self._publishers = {
            topic: self.create_publisher(type_of(TOPICS[topic]), topic, 10) for topic in self._messages.topics
        }
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
        belief = self._robot.belief
        if belief is not None:
            when = (message.header.stamp.sec, message.header.stamp.nanosec)
            for topic, said in self._messages.of(self._number, match, belief.places, when):
                self._publishers[topic].publish(said)
        self._number += 1


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
