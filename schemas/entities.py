"""Entity paths, coordinate frames, timelines and colours of every Rerun recording.

Where a quantity is also an MCAP topic (SPEC §4), its entity path is that topic and its frame that of Rerun's MCAP
loader: a collected `.mcap` file and a recording of a run open with the same blueprint.
"""

import re

APPLICATION_ID = "dense2sparse"

# Timelines
SIM_TIME = "sim_time"  # duration since the start of the episode
STEP = "step"  # row of the log: the state after action `step`
TRAINING_EPISODE = "training_episode"  # comparison: training episodes finished
RANK = "rank"  # perception: frames from the worst to the best

# Coordinate frames
WORLD = "world"
CAMERA = "camera"  # optical frame
IMAGE_PLANE = "camera_image_plane"  # what Rerun's MCAP loader calls the pixels of frame `camera`

# The scene
TRANSFORMS = "/tf"
TABLE = "/table"
ROBOT = "/robot"
LINKS = "/robot/links"
CUBE = "/cube"
CUBE_TRUE = "/cube/pose"
CUBE_EST = "/cube/estimate"
CUBE_ERROR = "/cube/error"
GRIPPER = "/gripper"
GRIPPER_POINT = "/gripper/point"
GRIPPER_PATH = "/gripper/path"

# The camera
CAMERA_ROOT = "/camera"
CALIBRATION = "/camera/calibration"
IMAGE = "/camera/image"
IMAGE_CUBE_TRUE = "/camera/image/cube_true"
IMAGE_CUBE_EST = "/camera/image/cube_est"
IMAGE_ERROR = "/camera/image/error"

# Over time
REWARD = "/reward"
REWARD_TERMS = ("dense_true", "dense_est", "sparse", "used")
DISTANCE = "/distance"
DISTANCE_TRUE = "/distance/true"
DISTANCE_EST = "/distance/est"
ESTIMATION_ERROR = "/estimation/error"
ACTION = "/action/applied"
JOINTS = "/joints/position"
STATE = "/state"
STATE_PHASE = "/state/phase"
STATE_SIGNALS = ("touched", "grasped", "lifted", "success")
DESCRIPTION = "/description"

# Comparison of runs
LEARNING_CURVES = "/learning_curves"

# Perception: test frames, from the worst to the best
FRAME_GROUP = "/frame/group"  # worst, median or best
FRAME_ERROR = "/frame/error"
ERROR_HISTOGRAM = "/errors/histogram"
TEST = "/test"
TEST_TRUE = "/test/true"
TEST_ERRORS = "/test/errors"

# Colours (r, g, b): what is true is green, what is estimated orange, their difference red, in every view
TRUE_COLOUR = (46, 184, 92)
ESTIMATED_COLOUR = (255, 140, 26)
ERROR_COLOUR = (232, 62, 90)
USED_COLOUR = (240, 242, 247)  # what the learner was given
GRIPPER_COLOUR = (74, 144, 255)
JOINT_COLOURS = (
    (102, 178, 255),
    (80, 200, 190),
    (140, 210, 110),
    (235, 205, 90),
    (240, 160, 90),
    (235, 110, 120),
    (190, 130, 235),
    (240, 242, 247),  # the gripper's command
)
SPARSE_COLOUR = (190, 130, 255)
NEUTRAL_COLOUR = (150, 156, 168)


def link(name: str) -> str:
    """Entity of a robot link, named as the simulator's body."""
    return f"{LINKS}/{name}"


def reward(term: str) -> str:
    """Entity of one reward term, one of `REWARD_TERMS`."""
    return f"{REWARD}/{term}"


def state(signal: str) -> str:
    """Entity of one of the simulator's completion signals, one of `STATE_SIGNALS`."""
    return f"{STATE}/{signal}"


def curves(panel: str) -> str:
    """Entity above the learning curves of one panel."""
    return f"{LEARNING_CURVES}/{_plain(panel)}"


def curve(panel: str, label: str, part: str) -> str:
    """Entity of one learning curve: `part` is mean, or spread for its two bounds."""
    return f"{curves(panel)}/{_plain(label)}/{part}"


def _plain(name: str) -> str:
    """Characters with a meaning in paths become `_`."""
    return re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_")
