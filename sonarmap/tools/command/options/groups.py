"""The groups in which `--help` lists options, in their order, and the largest counts."""

INPUT = "Input"
NAVIGATION = "Navigation"
SCENE = "Scene"
NOISE = "Noise"
REGISTRATION = "Registration"
EXPERIMENT = "Experiment"
OPTIMIZATION = "Optimization"
MEASUREMENT = "Measurement"
LOOPS = "Loops and motion"
EARTH = "Place on the Earth"
OUTPUT = "Output"
RUNNING = "Running"
GROUPS = (
    *(INPUT, NAVIGATION, SCENE, NOISE, REGISTRATION, EXPERIMENT, OPTIMIZATION, MEASUREMENT),
    *(LOOPS, EARTH, OUTPUT, RUNNING),
)

MOST_WORKERS = 1024  # more processes than any machine has use for
MOST = 1_000_000  # of whatever is counted, so that every file and library can hold the number

# As --priors of `simulate` and --known of `reproduce` name them.
INSTRUMENTS = ("attitude", "heading", "depth", "position")
