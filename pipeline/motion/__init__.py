"""How the robot moved: what the wheels say, what the laser says, and how far either is believed."""
