"""``python -m jaxhb``: the command line."""

import sys

from jaxhb.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
