"""What comes out: the series and scalars of a run, and tables of them.

``response`` has the series, ``demand`` the scalars, by mass, rod and link as ``elements`` says;
``columns`` makes tables.
"""
