"""Lets the tests import agreement, edits and merged_runs, which stand beside them."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
