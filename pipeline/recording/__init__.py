"""What is seen: the .rrd, its layout and the folder of a run. The only place that logs to rerun."""
