"""What `sonarmap map --also` can write: every format that has a writer but PLY and TUM, which are always written."""

from tools.writers.points import WRITERS
from tools.writers.trajectory import TRAJECTORY_WRITERS

# Name, as --also takes it -> the file, with a place for the number of the component
EXPORTS = {suffix[1:]: f"map{{}}{suffix}" for suffix in WRITERS if suffix != ".ply"} | {
    suffix[1:]: f"trajectory{{}}{suffix}" for suffix in TRAJECTORY_WRITERS if suffix != ".tum"
}
