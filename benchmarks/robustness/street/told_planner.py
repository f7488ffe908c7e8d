"""A planner program that records its input and returns prescribed bytes: ``told_planner.py FOLDER``.

``FOLDER`` holds ``answer`` (for standard output), ``error`` (for standard error) and ``status`` (the exit status). It
uses only the standard library.
"""

import sys
from pathlib import Path

folder = Path(sys.argv[1])
(folder / "request").write_bytes(sys.stdin.buffer.readline())
sys.stderr.buffer.write((folder / "error").read_bytes())
sys.stdout.buffer.write((folder / "answer").read_bytes())
sys.stdout.flush()
sys.exit(int((folder / "status").read_text()))
