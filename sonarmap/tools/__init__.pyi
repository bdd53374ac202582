from .api import PreparedScan as PreparedScan
from .api import compare as compare
from .api import locate as locate
from .api import map_scans as map_scans
from .api import optimize as optimize
from .api import prepare as prepare
from .api import read_scans as read_scans
from .api import register as register
from .files.geo import Georeference as Georeference
from .files.map_folder.folder import Map as Map
from .files.map_folder.folder import MapPart as MapPart
from .files.readers.navigation.priors import Navigated as Navigated
from .maps import export_map as export_map
from .maps import fuse as fuse
from .maps import read_navigation as read_navigation
from .maps import write_map as write_map
from .maps import write_report as write_report
from .products.compare.comparison import Comparison as Comparison
from .products.compare.comparison import NotAlignedError as NotAlignedError
from .products.export.run import Exported as Exported

__all__ = [
    "Comparison",
    "Exported",
    "Georeference",
    "Map",
    "MapPart",
    "Navigated",
    "NotAlignedError",
    "PreparedScan",
    "compare",
    "export_map",
    "fuse",
    "locate",
    "map_scans",
    "optimize",
    "prepare",
    "read_navigation",
    "read_scans",
    "register",
    "write_map",
    "write_report",
]
