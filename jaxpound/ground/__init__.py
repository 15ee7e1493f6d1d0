"""What shakes: ground motions, the files they are read from, and measures of their intensity.

``motion`` defines the interface of a ground motion, with sums and scalings; ``ricker`` has
wavelets, ``pulse`` those of near faults, ``record`` accelerograms, which ``reader`` reads from
files of the layouts in ``formats``; ``noise``, ``envelope`` and ``evolving`` make artificial ones
of white noise; ``intensity`` has measures; ``plausibility`` warns of implausible motions.
"""

from jaxpound.ground.motion import Ground as Ground
from jaxpound.ground.motion import GroundMotion as GroundMotion
from jaxpound.ground.motion import Scaled as Scaled
from jaxpound.ground.motion import Sum as Sum
