"""Runs the fault campaign of `tests/campaign`: random input must end well or in a typed error.

python -m scripts.campaign [FAMILY …] [--tries 100] [--seed 0]
"""

import sys

from tests.campaign.command import main

if __name__ == "__main__":
    sys.exit(main(__doc__ or ""))
