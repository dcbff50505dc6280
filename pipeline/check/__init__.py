"""One look at a log before anything else: what is wrong with it, how bad that is, and what to do."""
