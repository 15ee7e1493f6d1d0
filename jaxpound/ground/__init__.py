"""What shakes: ground motions, the files they are read from, and measures of their intensity.

``motion`` has wavelets, records, their sums and scalings; ``reader`` reads accelerograms with the
help of ``headers``; ``intensity`` measures; ``plausibility`` says what is implausible of a motion.
"""
