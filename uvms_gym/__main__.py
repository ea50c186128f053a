"""`python -m uvms_gym`: the same as `uvms`."""

import sys

from uvms_gym.cli import main

if __name__ == "__main__":
    sys.exit(main())
