"""`python -m hgo_rs.pages showcase.html`: the papers' observers, live, as one file."""

from __future__ import annotations

import sys
from pathlib import Path

from hgo_rs.errors import HgoError
from hgo_rs.files import replacing
from hgo_rs.pages.showcase import showcase


def main(words: list[str]) -> int:
    """Write the page to the one file that is named; 2 where it cannot be."""
    if len(words) != 1:
        print("usage: python -m hgo_rs.pages FILE.html", file=sys.stderr)
        return 2
    try:
        text = showcase()
    except HgoError as error:
        print(error, file=sys.stderr)
        return 2
    with replacing(Path(words[0])) as file:
        file.write(text.encode())
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
