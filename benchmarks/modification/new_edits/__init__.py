"""``make bench-edits``: whether the new edits do what they say, judged from the written file by code apart."""
