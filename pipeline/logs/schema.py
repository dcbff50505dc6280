"""The contract of a log's .mcap: topics, types, frames, quality of service, and the names of what travels beside them.

One file per log, ROS 2 profile, ``ros2msg`` schemas, ``cdr`` messages, zstd chunks, with summary and statistics.
Every message's log and publish time is its header's stamp; its ``sequence`` is the line (or message) number of
the source, so that a scan finds the odometry that belongs to it.

==============  ============================  =================================================================
topic           type                          what it says
==============  ============================  =================================================================
/scan           sensor_msgs/LaserScan         ranges in metres, as measured, in the frame ``laser``
/odom           nav_msgs/Odometry             base_link in ``odom``; from raw logs also one for every scan, at its stamp
/tf             tf2_msgs/TFMessage            the same as transforms
/tf_static      tf2_msgs/TFMessage            base_link -> laser, and base_link -> imu where there is one (latched)
/imu            sensor_msgs/Imu               turn rates of a gyroscope, where there is one, in the frame ``imu``
/map            nav_msgs/OccupancyGrid        the map, in steps of 1 % (latched)
/laser_pose     geometry_msgs/PoseStamped     the laser in ``odom``, where the source says it of its own
/ground_truth   geometry_msgs/PoseStamped     base_link in ``map``, where known
/view/...       TFMessage, PointCloud2        of the picture alone: where viewers draw it all, the robot, its path
==============  ============================  =================================================================

What a run found may be written beside what it was found from (``result``), as nav2's AMCL publishes it:

===============  =======================================  =====================================================
/amcl_pose       geometry_msgs/PoseWithCovarianceStamped  base_link in ``map``, at every scan's stamp (latched)
/particle_cloud  nav2_msgs/ParticleCloud                  particles with their weights
/particlecloud   geometry_msgs/PoseArray                  the same poses, for viewers that know no nav2_msgs
/diagnostics     diagnostic_msgs/DiagnosticArray          the verdict: OK, WARN if ambiguous, ERROR if lost; and why
/tf              tf2_msgs/TFMessage                       ``map`` -> ``odom``, beside what else is there
===============  =======================================  =====================================================

So may what the laser alone tells of the motion (``laser_odometry``), which needs no map: /laser_odom is a
nav_msgs/Odometry of base_link in ``odom``, where both odometries start. A reader takes it only if it is named.
"""

from __future__ import annotations

from typing import Final

PROFILE: Final = "ros2"
MESSAGE_ENCODING: Final = "cdr"
SCHEMA_ENCODING: Final = "ros2msg"

SCAN: Final = "/scan"
ODOMETRY: Final = "/odom"
TF: Final = "/tf"
TF_STATIC: Final = "/tf_static"
MAP: Final = "/map"
LASER_POSE: Final = "/laser_pose"
GROUND_TRUTH: Final = "/ground_truth"
IMU: Final = "/imu"
VIEW_TF: Final = "/view/tf"  # map and odometry side by side: nothing that is known of the robot
VIEW_ROBOT: Final = "/view/robot"
VIEW_PATH: Final = "/view/path"
VIEW_TRUE_TF: Final = "/view/true_tf"
VIEW_TRUE_ROBOT: Final = "/view/true_robot"
VIEW_TRUE_PATH: Final = "/view/true_path"
VIEW_TRANSFORMS: Final = frozenset({VIEW_TF, VIEW_TRUE_TF})

LASER_SCAN_TYPE: Final = "sensor_msgs/msg/LaserScan"
MULTI_ECHO_TYPE: Final = "sensor_msgs/msg/MultiEchoLaserScan"
ODOMETRY_TYPE: Final = "nav_msgs/msg/Odometry"
TF_TYPE: Final = "tf2_msgs/msg/TFMessage"
GRID_TYPE: Final = "nav_msgs/msg/OccupancyGrid"
POSE_TYPE: Final = "geometry_msgs/msg/PoseStamped"
CLOUD_TYPE: Final = "sensor_msgs/msg/PointCloud2"
IMU_TYPE: Final = "sensor_msgs/msg/Imu"

TYPES: Final = {
    SCAN: LASER_SCAN_TYPE,
    ODOMETRY: ODOMETRY_TYPE,
    TF: TF_TYPE,
    TF_STATIC: TF_TYPE,
    MAP: GRID_TYPE,
    LASER_POSE: POSE_TYPE,
    GROUND_TRUTH: POSE_TYPE,
    IMU: IMU_TYPE,
    VIEW_TF: TF_TYPE,
    VIEW_ROBOT: CLOUD_TYPE,
    VIEW_PATH: CLOUD_TYPE,
    VIEW_TRUE_TF: TF_TYPE,
    VIEW_TRUE_ROBOT: CLOUD_TYPE,
    VIEW_TRUE_PATH: CLOUD_TYPE,
}

AMCL_POSE: Final = "/amcl_pose"
PARTICLE_CLOUD: Final = "/particle_cloud"
POSE_ARRAY: Final = "/particlecloud"
DIAGNOSTICS: Final = "/diagnostics"
RESULT_TYPES: Final = {
    AMCL_POSE: "geometry_msgs/msg/PoseWithCovarianceStamped",
    PARTICLE_CLOUD: "nav2_msgs/msg/ParticleCloud",
    POSE_ARRAY: "geometry_msgs/msg/PoseArray",
    DIAGNOSTICS: "diagnostic_msgs/msg/DiagnosticArray",
}
LASER_ODOMETRY: Final = "/laser_odom"
RECORDED: Final = "/recorded"  # below it is what the input had under a result's name

NAV2_MSGS: Final = {
    "nav2_msgs/msg/Particle": "geometry_msgs/Pose pose\nfloat64 weight\n",
    "nav2_msgs/msg/ParticleCloud": "std_msgs/Header header\nnav2_msgs/Particle[] particles\n",
}
"""Definitions that ROS's own packages lack, and so any reader's store of them: they travel in the file."""

LATCHED: Final = frozenset({MAP, TF_STATIC, AMCL_POSE, VIEW_ROBOT, VIEW_PATH, VIEW_TRUE_ROBOT, VIEW_TRUE_PATH})

MAP_FRAME: Final = "map"
ODOM_FRAME: Final = "odom"
BASE_FRAME: Final = "base_link"
LASER_FRAME: Final = "laser"
IMU_FRAME: Final = "imu"
VIEW_FRAME: Final = "view"
TRUE_FRAME: Final = "true_base_link"

# Metadata records (name -> {key: text}).
SOURCE: Final = "mcl:source"  # format, files, checksums, converter, counts, laser offset, what was left out
SEGMENTS: Final = "mcl:segments"  # how stamps and odometry of the source were re-expressed: JSON per stretch
MAP_SOURCE: Final = "mcl:map"  # format, file and checksum of the map, and its header where it has one
FAULTS: Final = "mcl:faults"  # the faults made in it on purpose, one a key: for who judges a run
RESULT: Final = "mcl:result"  # of a result: version, seed, and the configuration as YAML
LASER_ODOMETRY_ABOUT: Final = "mcl:laser_odometry"  # of a file with /laser_odom: version, and who was heard
STRETCHES: Final = "mcl:stretches"  # where the recording began anew: nanoseconds of each stretch's first message
READER: Final = "reader"  # not in the file: what the reader chose and left out, in Log.metadata

# Attachments.
MAP_CELLS: Final = "map.npz"  # occupancy (height, width) float32, resolution, origin: all that /map rounds away


def qos_profile(topic: str) -> str:
    """The text of ``offered_qos_profiles``: reliable, and kept for late subscribers where the topic is latched.

    The integer form is the one that both old and new distributions of ROS 2 understand.
    """
    depth, durability = (1, 1) if topic in LATCHED else (10, 2)
    forever = "\n    sec: 9223372036\n    nsec: 854775807"
    return (
        f"- history: 1\n  depth: {depth}\n  reliability: 1\n  durability: {durability}\n"
        f"  deadline:{forever}\n  lifespan:{forever}\n"
        f"  liveliness: 1\n  liveliness_lease_duration:{forever}\n"
        "  avoid_ros_namespace_conventions: false"
    )
