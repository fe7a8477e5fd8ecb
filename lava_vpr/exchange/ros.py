"""Answers as messages of ROS 2: a pose for ``/initialpose``; what rtabmap says of a loop closure, and its link.

Poses are in metres, x to the east and y to the north (REP 103), in the frame `FRAME`: that of the map's positions, of
degrees the UTM zone of the first place. The robot heads as the route does at its place, as if the camera looked ahead.
What lies within a place is added to what the belief says: the square of its length / 12, as of anything that is spread
evenly, and the variances that RViz gives a pose set by hand.

rtabmap numbers its nodes from 1 (0 is none, -1 a place that it does not know): the place with the absolute index k is
node k + 1, and queries are counted on after the last place, as its next session would be.

Sources: geometry_msgs of ROS 2; introlab/rtabmap_ros, branch ros2, aec4f91: rtabmap_msgs/msg/Info.msg, Link.msg and
MapGraph.msg, and rtabmap_conversions/src/MsgConversion.cpp (a rotation of zeros is no transform); introlab/rtabmap,
corelib/include/rtabmap/core/Link.h (kinds of links; information is the inverse of a covariance) and
corelib/src/Memory.cpp (kIdVirtual, kIdInvalid); ros2/rviz, rviz_default_plugins, tools/pose_estimate/
initial_pose_tool.cpp (variances).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from typing import Any, NamedTuple, Protocol

import numpy as np
import utm
from numpy.typing import NDArray

from lava_vpr.matches import Match
from lava_vpr.model import Model
from lava_vpr.positions.frames import LAT_LON, Positions, utm_frame

FRAME = "map"
POSE, INFO, LINK = "initialpose", "rtabmap/info", "rtabmap/link"
TOPICS = {
    POSE: "geometry_msgs/msg/PoseWithCovarianceStamped",
    INFO: "rtabmap_msgs/msg/Info",
    LINK: "rtabmap_msgs/msg/Link",
}
"""The type of each topic; those of an image that is not accepted are `INFO` alone."""
DEFINITIONS = {
    "rtabmap_msgs/msg/Link": """
int32 from_id
int32 to_id
int32 type
geometry_msgs/Transform transform
float64[36] information
""",
    "rtabmap_msgs/msg/MapGraph": """
std_msgs/Header header
geometry_msgs/Transform map_to_odom
int32[] poses_id
geometry_msgs/Pose[] poses
Link[] links
""",
    "rtabmap_msgs/msg/Info": """
std_msgs/Header header
int32 ref_id
int32 loop_closure_id
int32 proximity_detection_id
int32 landmark_id
geometry_msgs/Transform loop_closure_transform
int32[] wm_state
int32[] posterior_keys
float32[] posterior_values
int32[] likelihood_keys
float32[] likelihood_values
int32[] raw_likelihood_keys
float32[] raw_likelihood_values
int32[] weights_keys
int32[] weights_values
int32[] labels_keys
string[] labels_values
string[] stats_keys
float32[] stats_values
int32[] local_path
int32 current_goal_id
MapGraph odom_cache
""",
}
"""Types that are not ROS's own, in its language of messages."""

OFF_MAP = -1
"""Key of being off the map in a posterior."""
LEAST = 1e-6
"""Places that are less likely are left out of a posterior."""
GLOBAL_CLOSURE = 1
"""Kind of a link between two images of the same place."""
FAINT = 1e-3
"""Places that are less likely than this share of the matched one are left out of a covariance: a robot may have been
kidnapped to any place, so the filter gives each a small probability, which far away would outweigh the rest."""
BY_HAND = (0.5**2, 0.5**2, (math.pi / 12) ** 2)
"""Variances of x and y, in square metres, and of the heading, in square radians, of a pose set by hand."""
ANY_ANGLE = math.pi**2 / 3
"""Variance of an angle of which nothing is known, in square radians."""
ANY_HEIGHT = 1e6
"""What stands for the variance of a height of which nothing is known, in square metres."""


class Make(Protocol):
    """What makes a message of a type, named as ``package/msg/Name``, from all its fields."""

    def __call__(self, kind: str, /, **fields: Any) -> Any: ...


class Pose(NamedTuple):
    """Where a robot is.

    Attributes:
        x, y: Metres.
        heading: Radians, from x towards y.
        covariance: Of these three, float64 (3, 3).
    """

    x: float
    y: float
    heading: float
    covariance: NDArray[np.float64]

    def six(self, heading: float = 0.0) -> NDArray[np.float64]:
        """The covariance of x, y, z and the rotations about them, float64 (6, 6), by axes turned by ``heading``."""
        turn = np.eye(3)
        turn[:2, :2] = [[math.cos(heading), math.sin(heading)], [-math.sin(heading), math.cos(heading)]]
        whole = np.diag([0.0, 0.0, ANY_HEIGHT, ANY_ANGLE, ANY_ANGLE, 0.0])
        whole[np.ix_((0, 1, 5), (0, 1, 5))] = turn @ self.covariance @ turn.T
        return whole


class RoutePoses(NamedTuple):
    """Poses of the places.

    Attributes:
        points: Metres, float64 (places, 2).
        headings: Where the route leads from each place, radians, float64 (places,).
        lengths: Metres from one place to the next, float64 (places,).
    """

    points: NDArray[np.float64]
    headings: NDArray[np.float64]
    lengths: NDArray[np.float64]

    @classmethod
    def of(cls, places: Positions) -> RoutePoses:
        """That of two or more ``places`` in driving order; a robot that stands keeps its heading.

        Raises:
            InputError: they are beyond UTM.
        """
        if places.frame == LAT_LON:
            latitude, longitude = places.values[0]
            zone = utm.latlon_to_zone_number(latitude, (longitude + 180.0) % 360.0 - 180.0)
            places = places.to(utm_frame(zone, bool(latitude >= 0)))
        steps = np.gradient(places.values, axis=0)
        lengths = np.hypot(*steps.T)
        moves = np.append(np.flatnonzero(lengths), len(steps) - 1)  # one at least
        last = moves[np.maximum(np.searchsorted(moves[:-1], np.arange(len(steps)), side="right") - 1, 0)]
        return cls(places.values, np.arctan2(steps[:, 1], steps[:, 0])[last], lengths)

    def pose(self, place: int, belief: NDArray[np.float64]) -> Pose:
        """The pose of a place, with the mean squares of how far off it others are, each as likely as it is believed.

        Args:
            place: Its number.
            belief: How likely each place is, float64 (places,), not all 0.
        """
        near = np.where(belief >= FAINT * belief[place], belief, 0.0)
        share = near / near.sum()
        turned = (self.headings - self.headings[place] + math.pi) % (2 * math.pi) - math.pi
        off = np.column_stack([self.points - self.points[place], turned])
        within = float(share @ self.lengths**2) / 12
        covariance = (off * share[:, None]).T @ off + np.diag(BY_HAND) + np.diag([within, within, 0.0])
        x, y = self.points[place].tolist()
        return Pose(x, y, float(self.headings[place]), covariance)


class Messages:
    """Makes messages of a model's answers.

    Args:
        model: The model.
        make: What makes a message.
        topics: Those that are wanted; without positions there are no poses, and no links, which would have no
            information.
    """

    def __init__(self, model: Model, make: Make, topics: Collection[str] = tuple(TOPICS)) -> None:
        self._make, self._indices = make, model.place_indices
        self._route = None if model.whereabouts is None else RoutePoses.of(model.whereabouts)
        self.topics = [topic for topic in TOPICS if topic in topics and (topic == INFO or self._route is not None)]

    def of(
        self, number: int, match: Match, belief: NDArray[np.float64], stamp: tuple[int, int]
    ) -> Iterator[tuple[str, Any]]:
        """Each topic that has something to say of an answer, and its message.

        Args:
            number: The query's.
            match: The answer.
            belief: How likely each place is, float64 (places,).
            stamp: When the query was taken, in seconds and nanoseconds.
        """
        header = self._make(
            "std_msgs/msg/Header",
            stamp=self._make("builtin_interfaces/msg/Time", sec=stamp[0], nanosec=stamp[1]),
            frame_id=FRAME,
        )
        node = int(self._indices.max()) + 2 + number
        if INFO in self.topics:
            yield INFO, self._info(header, node, match, belief)
        if self._route is None or not match.accepted:
            return
        pose = self._route.pose(int(np.argmax(self._indices == match.place)), belief)
        if POSE in self.topics:
            yield POSE, self._pose(header, pose)
        if LINK in self.topics:
            link: dict[str, Any] = {"from_id": node, "to_id": match.place + 1, "type": GLOBAL_CLOSURE}
            information = np.linalg.inv(pose.six(pose.heading)).reshape(-1)
            yield LINK, self._make(TOPICS[LINK], **link, transform=self._transform(), information=information)

    def _transform(self, *, known: bool = True) -> Any:
        """The transform that changes nothing; or none, which rtabmap writes as a rotation of zeros."""
        return self._make(
            "geometry_msgs/msg/Transform",
            translation=self._make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0),
            rotation=self._make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=float(known)),
        )

    def _pose(self, header: Any, pose: Pose) -> Any:
        half, make = pose.heading / 2, self._make
        turned = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=math.sin(half), w=math.cos(half))
        there = make(
            "geometry_msgs/msg/Pose",
            position=make("geometry_msgs/msg/Point", x=pose.x, y=pose.y, z=0.0),
            orientation=turned,
        )
        covariance = pose.six().reshape(-1)
        return make(
            TOPICS[POSE],
            header=header,
            pose=make("geometry_msgs/msg/PoseWithCovariance", pose=there, covariance=covariance),
        )

    def _info(self, header: Any, node: int, match: Match, belief: NDArray[np.float64]) -> Any:
        likely = np.flatnonzero(belief >= LEAST)
        numbers: Any = {name: 0 for name in ("proximity_detection_id", "landmark_id", "current_goal_id")}
        lists = ("likelihood", "raw_likelihood", "weights", "labels", "stats")
        integers = ("wm_state", "local_path", *(f"{name}_keys" for name in lists[:-1]), "weights_values")
        empty: Any = {name: np.zeros(0, np.int32) for name in integers}
        empty |= {f"{name}_values": np.zeros(0, np.float32) for name in ("likelihood", "raw_likelihood", "stats")}
        graph = {"poses_id": np.zeros(0, np.int32), "poses": [], "links": []}
        return self._make(
            TOPICS[INFO],
            header=header,
            ref_id=node,
            loop_closure_id=match.place + 1 if match.accepted else 0,
            loop_closure_transform=self._transform(known=match.accepted),
            posterior_keys=np.array([OFF_MAP, *(self._indices[likely] + 1)], np.int32),
            posterior_values=np.array([match.off_map, *belief[likely]], np.float32),
            odom_cache=self._make("rtabmap_msgs/msg/MapGraph", header=header, map_to_odom=self._transform(), **graph),
            labels_values=[],
            stats_keys=[],
            **numbers,
            **empty,
        )
