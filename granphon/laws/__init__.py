"""Contact laws of balls that differ: averaged force and effective medium.

All are averages of Hertz's law over diameters. They hold its exponents themselves, as their closed
forms and quadratures are those of its powers: they serve no other law, and a packing, of which they
are made, has no other.
"""
