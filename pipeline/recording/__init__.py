"""What is seen: the .rrd, its layout and the folder of a run. The only place that logs to rerun."""

import os

# A file that can no longer be written is told by us, in one line. Rerun reads this when it is loaded.
os.environ.setdefault("RUST_LOG", "warn,re_log_encoding=off,re_sdk::recording_stream=off")
