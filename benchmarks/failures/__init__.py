"""``make bench-failures``: how well failures of planners are found, reproduced and reduced."""
