"""Maps: the occupancy grid and what is pre-computed from it."""
