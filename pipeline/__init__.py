"""mcl-replay: a laser-and-odometry log and a map go in, a recording of how the lost robot was found comes out."""

__version__ = "0.1.0"
