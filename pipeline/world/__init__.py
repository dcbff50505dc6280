"""The world: what the map says of it, what the map leaves open, and what the log itself has shown."""
