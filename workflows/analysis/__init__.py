"""The tools that analyse and compare runs: trials of what is suggested, and test suites with limits."""
