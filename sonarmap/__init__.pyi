from .kernels.device.device import Device as Device
from .kernels.device.device import choose_device as choose_device
from .kernels.device.device import list_devices as list_devices
from .kernels.device.device_info import DeviceInfo as DeviceInfo
from .kernels.errors import DeviceError as DeviceError
from .kernels.errors import InputError as InputError
from .kernels.errors import SonarmapError as SonarmapError
from .slam.candidates.settings import LoopSettings as LoopSettings
from .slam.graph.control import ControlPoint as ControlPoint
from .slam.graph.edge import Edge as Edge
from .slam.graph.gtsam_poses import to_transforms as to_transforms
from .slam.graph.gtsam_poses import to_values as to_values
from .slam.graph.pose_graph import PoseGraph as PoseGraph
from .slam.graph.pose_graph import Solution as Solution
from .slam.graph.pose_graph import factors_of as factors_of
from .slam.graph.trajectory import Trajectory as Trajectory
from .slam.locate.place import Located as Located
from .slam.locate.place import Place as Place
from .slam.map.point_map import PointMap as PointMap
from .slam.mapper import Mapper as Mapper
from .slam.mapper_settings import MapperSettings as MapperSettings
from .slam.motion.limits import MotionLimits as MotionLimits
from .slam.motion.odometry import Odometry as Odometry
from .slam.optimize.solve import Optimized as Optimized
from .slam.pair import Pair as Pair
from .slam.stream.keys import KeySettings as KeySettings
from .slam.survey_result import SurveyResult as SurveyResult
from .slam.tie import Tie as Tie
from .spectral.grid import Grid as Grid
from .spectral.grid import choose_grid as choose_grid
from .spectral.hemisphere import HemisphereConfig as HemisphereConfig
from .spectral.hemisphere import HemisphereRegistrar as HemisphereRegistrar
from .spectral.prior import RelativePrior as RelativePrior
from .spectral.prior import relative_prior as relative_prior
from .spectral.registration import SpectralConfig as SpectralConfig
from .spectral.registration import SpectralRegistrar as SpectralRegistrar
from .spectral.result import Registrar as Registrar
from .spectral.result import Registration as Registration
from .spectral.scan import PosePrior as PosePrior
from .spectral.scan import Scan as Scan
from .tools.api import PreparedScan as PreparedScan
from .tools.api import compare as compare
from .tools.api import locate as locate
from .tools.api import map_scans as map_scans
from .tools.api import optimize as optimize
from .tools.api import prepare as prepare
from .tools.api import read_scans as read_scans
from .tools.api import register as register
from .tools.files.geo import Georeference as Georeference
from .tools.files.map_folder.folder import Map as Map
from .tools.files.map_folder.folder import MapPart as MapPart
from .tools.files.readers.navigation.priors import Navigated as Navigated
from .tools.maps import export_map as export_map
from .tools.maps import fuse as fuse
from .tools.maps import read_navigation as read_navigation
from .tools.maps import write_map as write_map
from .tools.maps import write_report as write_report
from .tools.products.compare.comparison import Comparison as Comparison
from .tools.products.compare.comparison import NotAlignedError as NotAlignedError
from .tools.products.export.run import Exported as Exported

__all__ = [
    "Comparison",
    "ControlPoint",
    "Device",
    "DeviceError",
    "DeviceInfo",
    "Edge",
    "Exported",
    "Georeference",
    "Grid",
    "HemisphereConfig",
    "HemisphereRegistrar",
    "InputError",
    "KeySettings",
    "Located",
    "LoopSettings",
    "Map",
    "MapPart",
    "Mapper",
    "MapperSettings",
    "MotionLimits",
    "Navigated",
    "NotAlignedError",
    "Odometry",
    "Optimized",
    "Pair",
    "Place",
    "PointMap",
    "PoseGraph",
    "PosePrior",
    "PreparedScan",
    "Registrar",
    "Registration",
    "RelativePrior",
    "Scan",
    "Solution",
    "SonarmapError",
    "SpectralConfig",
    "SpectralRegistrar",
    "SurveyResult",
    "Tie",
    "Trajectory",
    "choose_device",
    "choose_grid",
    "compare",
    "export_map",
    "factors_of",
    "fuse",
    "list_devices",
    "locate",
    "map_scans",
    "optimize",
    "prepare",
    "read_navigation",
    "read_scans",
    "register",
    "relative_prior",
    "to_transforms",
    "to_values",
    "write_map",
    "write_report",
]
