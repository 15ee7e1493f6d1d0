"""``python -m jaxpound``: the command line."""

import sys

from jaxpound.cli import main

sys.exit(main())
