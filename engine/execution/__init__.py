"""Worker processes and jobs: where native code runs, with limits, and how its progress comes back."""
