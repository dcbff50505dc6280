"""How the robot moved, and what that does to what it measured meanwhile."""
