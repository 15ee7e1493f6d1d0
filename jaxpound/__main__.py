"""``python -m jaxpound``: the command line."""

import sys

from jaxpound.cli.main import main

sys.exit(main())
