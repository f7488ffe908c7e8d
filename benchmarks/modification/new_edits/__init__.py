"""``make bench-edits``: checks the newer edits on the written file, with independent code."""
