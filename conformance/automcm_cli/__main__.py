"""The script ``automcm`` and ``python -m automcm_cli``; names the extra if the kit is missing."""

from __future__ import annotations

import sys
from itertools import takewhile

from automcm_spec.support.collection import uncollected
from automcm_spec.support.extras import missing


def main() -> None:
    """Run the command.  Exits with code 3 if the extra ``kit`` is not installed."""
    if lacks := missing("kit"):
        name = " ".join(takewhile(lambda word: word[:1] != "-", sys.argv[1:3]))
        print(f"{name or 'automcm'}: {lacks}", file=sys.stderr)
        sys.exit(3)
    with uncollected():
        from automcm_cli.main import main as command
    command()


if __name__ == "__main__":
    main()
