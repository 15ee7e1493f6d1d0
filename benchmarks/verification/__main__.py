"""Run the verification suite: python -m benchmarks.verification; see ``command``."""

import sys

import jaxpound as jp

jp.runtime.use_cores()  # before anything is computed, as the imports below do

from benchmarks.verification.command import main  # noqa: E402

sys.exit(main())
