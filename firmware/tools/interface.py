"""The C interface: `c/main.c` must print the same on the board and on this computer."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "c"))

from example import check as check
