"""Contact laws of balls whose diameters differ: the averaged force and the effective medium."""
