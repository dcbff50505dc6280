"""Monte Carlo localization, as in Probabilistic Robotics: one idea a file."""
