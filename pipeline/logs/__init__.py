"""Reading recordings: one .mcap in, scans with odometry out."""
