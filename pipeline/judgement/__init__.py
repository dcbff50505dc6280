"""Judgement: what the scans say for one place against another, and how much can be trusted of what was found."""
