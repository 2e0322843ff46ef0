"""Contact laws of balls that differ: averaged force and effective medium.

All are averages of Hertz's law over diameters. Their closed forms and quadratures are those of its
powers, so its exponents stand in this package too. They serve no other contact law; packings, from
which they are made, have no other.
"""
