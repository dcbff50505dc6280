"""Every name in the recording, once: entities, timelines, the ids, and the components that ``inspect`` reads back."""

from __future__ import annotations

import hashlib

from pipeline.config import Config
from pipeline.logs.messages import Log

APPLICATION_ID = "mcl"
SEVERAL_ID = "mcl-several"  # a viewer keeps one layout per application, and several runs need another one
LOG_ID = "mcl-log"
LESSON_ID = "mcl-lesson"

SCAN = "scan"  # timeline: index of the scan
TIME = "t"  # timeline: duration since the first scan
SUBSTEP = "substep"  # timeline: number of the sub-step; only what is drawn of those is on it
LOG_TIME = "log_time"  # timeline: wall clock; what `rerun rrd compare` leaves out

# The map frame, metres. What moves with the robot hangs below a transform of its own.
WORLD = "/world"
MAP = "/world/map"
HEAT = "/world/heat"  # what a search of the building found
CHANGED = "/world/changed"  # where the world is not as mapped
PARTICLES = "/world/particles"
LASER = "/world/laser"
HITS = "/world/laser/hits"
SHORTS = "/world/laser/shorts"
LONGS = "/world/laser/longs"
EXPECTED = "/world/laser/expected"
NO_RETURN = "/world/laser/no_return"
WORST = "/world/laser/worst"  # ends of the beams that the map explains least
ESTIMATE = "/world/estimate"
ESTIMATE_BODY = "/world/estimate/body"
ESTIMATE_HEADING = "/world/estimate/heading"
HERE = "/world/here"  # where the estimate is, but never turned: what follows the robot hangs below it
ESTIMATE_NAME = "/world/here/name"  # while the truth is elsewhere
COVARIANCE = "/world/covariance"
HYPOTHESES = "/world/hypotheses"
SHARES = "/world/hypotheses/share"
PATH = "/world/path"
HINDSIGHT = "/world/hindsight"
TRUTH = "/world/truth"
TRUTH_BODY = "/world/truth/body"
TRUTH_HEADING = "/world/truth/heading"
TRUTH_NAME = "/world/truth/name"
TRUTH_PATH = "/world/truth_path"
SCALE_BAR = "/world/scale_bar"
CLOSE_BAR = "/world/here/scale_bar"
CAMERA = "/world/camera"  # looks straight down; the flat view is its picture

# The parts of a filter's turn, one by one; only where somebody asked for them.
SUBSTEP_WORLD = "/world/substep"
SUBSTEP_PARTICLES = "/world/substep/particles"
SUBSTEP_MOVES = "/world/substep/moves"
SUBSTEP_ELLIPSE = "/world/substep/ellipse"
COMB = "/comb"  # a plot
COMB_WEIGHTS = "/comb/cumulative_weights"
COMB_TEETH = "/comb/drawn"
SUBSTEP_TEXT = "/about/substep"
SUBSTEP_KIND = "/states/substep"

# What wheels and laser say of the way; only where the laser's own odometry is heard.
WALLS = "/world/laser/walls"  # that the laser's odometry remembers, in its frame
SAID = "/world/said"  # while the two contradict each other
SAID_WHEELS = "/world/said/wheels"
SAID_LASER = "/world/said/laser"
SAID_SHARE = "/world/said/share"
SAID_SCAN = "/world/said/scan"  # where the scan would be if the wheels were right
MOTION = "/motion"  # the odometry's frame
WAYS = "/motion/paths"  # by the wheels if there are any, by the laser, as believed: in this order
HEADS = "/motion/robots"
APART = "/curves/apart"
FIT = "/curves/fit"
FOLLOWED = "/curves/followed"
WON = "/states/motion"  # which component of the motion prior most of the belief follows

# The viewer writes these two names into the legend.
WEIGHTS = "/weights/percent_of_particles"
WEIGHT_SHARE = "/weights/percent_of_weight"
PARTS = "/sensor_model/parts"  # its parts on top of each other, and what was measured
MEASURED = "/sensor_model/parts/measured"
DENSITY_NOTE = "/sensor_model/note"

ESS = "/curves/ess"
PARTICLE_COUNT = "/curves/particles"
LIKELIHOOD = "/curves/likelihood"
EXPLAINED = "/curves/explained"
SPREAD = "/curves/spread"
SHORT = "/curves/short"
THROUGH = "/curves/through"
PROBABILITY = "/curves/probability"
ERROR = "/curves/error"  # only where the truth is known
TWO_SIGMA = "/curves/two_sigma"
VERDICT = "/states/verdict"
EVENTS = "/events"

CAPTION = "/about/caption"  # what is the matter at a scan
EVENTS_TABLE = "/about/events"  # what happened until then
EXPLANATION = "/about/explanation"
RUN = "/about/run"
RESULT = "/about/result"

# For programs: full precision, exact stamps.
RECORD = "/record/estimate"
TIMINGS = "/record/timings"

RECORD_TYPE = "mcl.Estimate"
EVENT_TYPE = "mcl.Event"
TIMING_TYPE = "mcl.Timing"
PROPERTY_RUN = "run"
PROPERTY_RESULT = "result"


def recording_id(log: Log, config: Config, seed: int) -> str:
    """The same for the same log, configuration and seed, and for nothing else."""
    digest = hashlib.sha256(f"{log.sha256}\n{config.model_dump_json()}".encode()).hexdigest()
    return f"{log.name}-{digest[:12]}-seed{seed}"
