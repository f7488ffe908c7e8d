"""``make bench-tuning``: planners, their tuning, and runs on more than one machine."""
