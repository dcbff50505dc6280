"""A recorded run as something else: pictures, movies, tables."""
