"""All pictures of the flood gate, and what they show."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from tools.reproduce.floodgate.maps_figure import draw_maps
from tools.reproduce.floodgate.motion_figure import draw_motion, draw_poses
from tools.reproduce.floodgate.scans_figure import draw_scans
from tools.reproduce.floodgate.survey import survey
from tools.reproduce.floodgate.tables import Chains

PICTURES: Mapping[str, str] = MappingProxyType(
    {
        "floodgate-maps.png": "The maps from above, as Figs. 25, 28 and 30, colored by the height of the highest "
        "point. Over them the true plan: outlines of what is solid 4 m below the water's surface. Black the true "
        "way, magenta the one that was found; both begin at the same pose.",
        "floodgate-errors.png": "The same maps, colored by how far each point lies from the true surface, what is "
        "wrong over what is right. Gray is solid.",
        "floodgate-motion.png": "Motion estimates, as Fig. 31: from each scan to the next, by every method, beside the "
        "true ones. Marks at the rim lie beyond it.",
        "floodgate-poses.png": "How the errors grow along the chain.",
        "floodgate-scans.png": "Two of the scans, as Fig. 24, colored by height, without the few echoes that lie far "
        "off. The sensor is magenta.",
    }
)


def draw_floodgate(folder: Path, chains: Chains, seed: int, scans: int) -> None:
    """Write PICTURES into an existing folder, of one survey."""
    maps, errors, motion, poses, examples = (folder / name for name in PICTURES)
    now = survey(seed, scans)
    draw_maps(maps, errors, now, chains, seed)
    draw_motion(motion, chains, seed)
    draw_poses(poses, chains, seed)
    draw_scans(examples, now)
