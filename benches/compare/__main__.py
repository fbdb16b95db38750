"""python benches/compare [--out out] [--workload NAME ...] [--quick]"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from compare.command import main

if __name__ == "__main__":
    sys.exit(main())
