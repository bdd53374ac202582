from .candidates.settings import LoopSettings as LoopSettings
from .graph.control import ControlPoint as ControlPoint
from .graph.edge import Edge as Edge
from .graph.gtsam_poses import to_transforms as to_transforms
from .graph.gtsam_poses import to_values as to_values
from .graph.pose_graph import PoseGraph as PoseGraph
from .graph.pose_graph import Solution as Solution
from .graph.pose_graph import factors_of as factors_of
from .graph.trajectory import Trajectory as Trajectory
from .locate.place import Located as Located
from .locate.place import Place as Place
from .map.point_map import PointMap as PointMap
from .mapper import Mapper as Mapper
from .mapper_settings import MapperSettings as MapperSettings
from .motion.limits import MotionLimits as MotionLimits
from .motion.odometry import Odometry as Odometry
from .optimize.solve import Optimized as Optimized
from .pair import Pair as Pair
from .stream.keys import KeySettings as KeySettings
from .survey_result import SurveyResult as SurveyResult
from .tie import Tie as Tie

__all__ = [
    "ControlPoint",
    "Edge",
    "KeySettings",
    "Located",
    "LoopSettings",
    "Mapper",
    "MapperSettings",
    "MotionLimits",
    "Odometry",
    "Optimized",
    "Pair",
    "Place",
    "PointMap",
    "PoseGraph",
    "Solution",
    "SurveyResult",
    "Tie",
    "Trajectory",
    "factors_of",
    "to_transforms",
    "to_values",
]
